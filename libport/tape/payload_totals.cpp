#include "libport/tape/payload_totals.hpp"

#include <array>
#include <cinttypes>
#include <cstdio>

// Compiled in: no library is needed to run.
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "libport/tape/block.hpp"

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

struct StreamDigest::State {
  XXH3_state_t xxh3;
};

StreamDigest::StreamDigest() : state_(std::make_unique_for_overwrite<State>()) {
  XXH3_64bits_reset(&state_->xxh3);
}
StreamDigest::StreamDigest(const StreamDigest& other) : state_(std::make_unique_for_overwrite<State>()) {
  XXH3_copyState(&state_->xxh3, &other.state_->xxh3);
}
StreamDigest& StreamDigest::operator=(const StreamDigest& other) { return *this = StreamDigest(other); }
StreamDigest::StreamDigest(StreamDigest&&) noexcept = default;
StreamDigest& StreamDigest::operator=(StreamDigest&&) noexcept = default;
StreamDigest::~StreamDigest() = default;

void StreamDigest::add(ByteView data) { XXH3_64bits_update(&state_->xxh3, data.data(), data.size()); }
std::uint64_t StreamDigest::value() const { return XXH3_64bits_digest(&state_->xxh3); }

PayloadCounter::PayloadCounter(bool with_digests) {
  if (with_digests) digests_.emplace();
}

void PayloadCounter::begin_block(TapeTime at, std::uint32_t length) {
  ++blocks_;
  if (digests_) digests_->all.add(encode_header(at, length));
}

void PayloadCounter::add(ByteView data) {
  bytes_ += data.size();
  if (!digests_) return;
  digests_->payload.add(data);
  digests_->all.add(data);
}

PayloadTotals PayloadCounter::totals() const {
  if (!digests_) return {blocks_, bytes_, std::nullopt, std::nullopt};
  return {blocks_, bytes_, digests_->payload.value(), digests_->all.value()};
}

}  // namespace porttape
