#include "libport/replay/seconds_text.hpp"

#include <array>
#include <cstdio>

namespace porttape {

std::string seconds_text(std::int64_t us) {
  const bool negative = us < 0;
  const std::uint64_t size =
      negative ? std::uint64_t{0} - static_cast<std::uint64_t>(us) : static_cast<std::uint64_t>(us);
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%s%llu.%06llu s", negative ? "-" : "",
                static_cast<unsigned long long>(size / 1'000'000),
                static_cast<unsigned long long>(size % 1'000'000));
  return text.data();
}

}  // namespace porttape
