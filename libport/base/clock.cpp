#include "libport/base/clock.hpp"

namespace porttape {
namespace {

class MachineClock final : public Clock {
 public:
  [[nodiscard]] Instant now() const override { return std::chrono::steady_clock::now(); }
  [[nodiscard]] WallTime wall() const override { return std::chrono::system_clock::now(); }
  [[nodiscard]] std::optional<Instant> machine_time(Instant when) const override { return when; }
};

}  // namespace

const Clock& machine_clock() {
  static const MachineClock clock;
  return clock;
}

}  // namespace porttape
