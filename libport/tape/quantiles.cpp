#include "libport/tape/quantiles.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace porttape {

// Below kSteps a bucket a value; above, kSteps buckets for the values with the same highest bit.
std::size_t Quantiles::bucket_of(std::uint64_t value) {
  if (value < kSteps) return static_cast<std::size_t>(value);
  const auto shift = static_cast<unsigned>(std::bit_width(value)) - kStepBits - 1;
  return (shift + 1) * kSteps + static_cast<std::size_t>(value >> shift) - kSteps;
}

std::int64_t Quantiles::middle_of(std::size_t bucket) {
  if (bucket < kSteps) return static_cast<std::int64_t>(bucket);
  const std::size_t shift = bucket / kSteps - 1;
  const std::uint64_t low = std::uint64_t{bucket % kSteps + kSteps} << shift;
  return static_cast<std::int64_t>(low + (std::uint64_t{1} << shift) / 2);
}

void Quantiles::add(std::int64_t value) {
  value = std::max<std::int64_t>(value, 0);
  min_ = count_ == 0 ? value : std::min(min_, value);
  max_ = std::max(max_, value);
  ++count_;
  if (buckets_.empty() && exact_.size() < kExact) {
    exact_.push_back(value);
    return;
  }
  if (buckets_.empty()) {
    buckets_.resize((64 - kStepBits + 1) * kSteps);
    for (const std::int64_t each : exact_) ++buckets_[bucket_of(static_cast<std::uint64_t>(each))];
    exact_ = {};
  }
  ++buckets_[bucket_of(static_cast<std::uint64_t>(value))];
}

std::int64_t Quantiles::at(double q) const {
  if (count_ == 0) return 0;
  const auto wanted = static_cast<std::uint64_t>(std::ceil(q * static_cast<double>(count_)));
  const std::uint64_t rank = std::clamp<std::uint64_t>(wanted, 1, count_);
  if (buckets_.empty()) {
    std::vector<std::int64_t> sorted = exact_;
    const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(rank - 1);
    std::nth_element(sorted.begin(), nth, sorted.end());
    return *nth;
  }
  if (rank == count_) return max_;
  std::uint64_t seen = 0;
  for (std::size_t i = 0; i < buckets_.size(); ++i) {
    seen += buckets_[i];
    if (seen >= rank) return std::clamp(middle_of(i), min_, max_);
  }
  return max_;
}

}  // namespace porttape
