#include "libport/formats/tape_wall.hpp"

namespace porttape {
namespace {

constexpr const char* kBeginOfTime = "1970-01-01T00:00:00.000000Z";

}  // namespace

std::uint64_t wall_us_of_zero(const std::optional<TapeHeader>& header) {
  if (!header || !header->zero) return 0;
  TapeZero on_wall = *header->zero;
  on_wall.boot.clear();
  const auto apart = since({kBeginOfTime, 0, ""}, on_wall);
  return apart && apart->count() > 0 ? static_cast<std::uint64_t>(apart->count()) : 0;
}

}  // namespace porttape
