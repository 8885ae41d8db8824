#include "libport/replay/lateness.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace porttape {

// Values below 16 have a bucket each; above, the four bits after the leading one choose among 16 steps.
std::size_t LatenessHistogram::bucket_of(std::uint64_t nanos) {
  const auto width = static_cast<unsigned>(std::bit_width(nanos));
  if (width <= kStepBits) return static_cast<std::size_t>(nanos);
  const unsigned shift = width - kStepBits - 1;
  const std::uint64_t step = (nanos >> shift) & ((1U << kStepBits) - 1U);
  return (static_cast<std::size_t>(shift + 1) << kStepBits) + static_cast<std::size_t>(step);
}

std::uint64_t LatenessHistogram::upper_end(std::size_t bucket) {
  const std::size_t group = bucket >> kStepBits;
  const std::uint64_t step = bucket & ((1U << kStepBits) - 1U);
  if (group == 0) return step;
  const auto shift = static_cast<unsigned>(group - 1);
  return ((((std::uint64_t{1} << kStepBits) + step + 1) << shift)) - 1;
}

void LatenessHistogram::add(Nanos late) {
  late = std::max(late, Nanos{0});
  ++buckets_[bucket_of(static_cast<std::uint64_t>(late.count()))];
  ++count_;
  max_ = std::max(max_, late);
}

Nanos LatenessHistogram::quantile(double fraction) const {
  if (count_ == 0) return Nanos{0};
  const auto wanted = static_cast<std::uint64_t>(std::ceil(fraction * static_cast<double>(count_)));
  const std::uint64_t rank = std::clamp<std::uint64_t>(wanted, 1, count_);
  std::uint64_t seen = 0;
  for (std::size_t bucket = 0; bucket < kBuckets; ++bucket) {
    seen += buckets_[bucket];
    if (seen >= rank) return std::min(Nanos{static_cast<std::int64_t>(upper_end(bucket))}, max_);
  }
  return max_;
}

}  // namespace porttape
