#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace porttape {

// Order statistics of whole numbers from 0 up, in constant memory: exact up to kExact values, beyond that
// within 1 % (min and max stay exact).
class Quantiles {
 public:
  static constexpr std::size_t kExact = 16384;

  void add(std::int64_t value);

  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] std::int64_t min() const { return min_; }
  [[nodiscard]] std::int64_t max() const { return max_; }
  // The smallest value that at least the share q of all are not above (nearest rank); 0 if there are none.
  [[nodiscard]] std::int64_t at(double q) const;

 private:
  static constexpr unsigned kStepBits = 6;  // 64 steps for each doubling
  static constexpr std::size_t kSteps = std::size_t{1} << kStepBits;

  static std::size_t bucket_of(std::uint64_t value);
  static std::int64_t middle_of(std::size_t bucket);

  std::uint64_t count_ = 0;
  std::int64_t min_ = 0;
  std::int64_t max_ = 0;
  std::vector<std::int64_t> exact_;
  std::vector<std::uint64_t> buckets_;  // in use once there are more than kExact values
};

}  // namespace porttape
