#include "libport/tape/payload_totals.hpp"

#include <array>
#include <cinttypes>
#include <cstdio>

// Compiled in: no library is needed to run.
#define XXH_INLINE_ALL
#include <xxhash.h>

namespace porttape {

static_assert(XXH_VERSION_NUMBER >= 800, "XXH3 is stable from xxHash 0.8.0 on");

std::string digest_text(std::uint64_t xxh3) {
  std::array<char, 17> hex{};
  std::snprintf(hex.data(), hex.size(), "%016" PRIx64, xxh3);
  return hex.data();
}

std::uint64_t digest_of(ByteView data, std::uint64_t seed) {
  return XXH3_64bits_withSeed(data.data(), data.size(), seed);
}

struct PayloadCounter::Digest {
  XXH3_state_t state;
};

PayloadCounter::PayloadCounter(bool with_digest) {
  if (!with_digest) return;
  digest_ = std::make_unique_for_overwrite<Digest>();
  XXH3_64bits_reset(&digest_->state);
}
PayloadCounter::PayloadCounter(PayloadCounter&&) noexcept = default;
PayloadCounter& PayloadCounter::operator=(PayloadCounter&&) noexcept = default;
PayloadCounter::~PayloadCounter() = default;

void PayloadCounter::add(ByteView data) {
  bytes_ += data.size();
  if (digest_) XXH3_64bits_update(&digest_->state, data.data(), data.size());
}

PayloadTotals PayloadCounter::totals() const {
  if (!digest_) return {blocks_, bytes_, std::nullopt};
  return {blocks_, bytes_, XXH3_64bits_digest(&digest_->state)};
}

}  // namespace porttape
