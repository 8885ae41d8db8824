#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace porttape::bench {

// The q-quantile (0..1) by nearest rank; 0 for no values.
inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  const auto last = static_cast<double>(values.size() - 1);
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(q * last + 0.5);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

inline double median(const std::vector<double>& values) { return quantile(values, 0.5); }

}  // namespace porttape::bench
