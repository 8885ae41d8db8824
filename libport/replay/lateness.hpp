#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "libport/base/time.hpp"

namespace porttape {

// How late deliveries were: a histogram with 16 steps to each doubling (within 7 %), 8 KiB whatever the
// number of samples. The maximum is exact. A negative sample counts as zero.
class LatenessHistogram {
 public:
  void add(Nanos late);

  // The lateness that `fraction` (0..1) of the samples did not exceed; zero without samples.
  [[nodiscard]] Nanos quantile(double fraction) const;
  [[nodiscard]] Nanos max() const { return max_; }
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  static constexpr unsigned kStepBits = 4;
  static constexpr std::size_t kBuckets = std::size_t{64} << kStepBits;

  static std::size_t bucket_of(std::uint64_t nanos);
  static std::uint64_t upper_end(std::size_t bucket);

  std::array<std::uint64_t, kBuckets> buckets_{};
  std::uint64_t count_ = 0;
  Nanos max_{0};
};

}  // namespace porttape
