#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"

namespace porttape::test {

// What must always hold; the end of the program where it does not.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", what);
  std::abort();
}

// Numbers and texts out of a fuzzer's input; zeros and empty texts when it is used up.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data, size) {}

  // In [0, n).
  std::uint32_t operator()(std::uint32_t n) {
    if (n == 0 || used_ >= data_.size()) return 0;
    std::uint32_t value = data_[used_++];
    if (n > 256 && used_ < data_.size()) value = value << 8U | data_[used_++];
    return value % n;
  }

  std::uint64_t number() {
    std::uint64_t value = 0;
    for (std::uint32_t bytes = (*this)(9); bytes > 0; --bytes) value = value << 8U | (*this)(256);
    return value;
  }

  std::string text() {
    const std::size_t size = (*this)(16);
    const ByteView bytes = data_.subspan(used_, std::min(size, data_.size() - used_));
    used_ += bytes.size();
    return std::string(as_text(bytes));
  }

  // All that is left.
  std::string_view rest() {
    const ByteView bytes = data_.subspan(used_);
    used_ = data_.size();
    return as_text(bytes);
  }

  [[nodiscard]] bool done() const { return used_ >= data_.size(); }

 private:
  ByteView data_;
  std::size_t used_ = 0;
};

// Numbers out of a fuzzer's input, many to a byte; zeros when it is used up. For inputs that are nothing but
// choices: what is to be found is found in shorter ones, and these run faster.
class Choices {
 public:
  Choices(const std::uint8_t* data, std::size_t size) : data_(data, size) {}

  // In [0, n).
  std::uint32_t operator()(std::uint32_t n) {
    if (n == 0) return 0;
    while (left_ < n && !done()) {
      pool_ = pool_ << 8U | data_[used_++];
      left_ <<= 8U;
    }
    const std::uint64_t value = pool_ % n;
    pool_ /= n;
    left_ = std::max<std::uint64_t>(left_ / n, 1);
    return static_cast<std::uint32_t>(value);
  }

  [[nodiscard]] bool done() const { return used_ >= data_.size(); }

 private:
  ByteView data_;
  std::size_t used_ = 0;
  std::uint64_t pool_ = 0;  // of what was read and not given yet, a number in [0, left_)
  std::uint64_t left_ = 1;
};

}  // namespace porttape::test
