#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace porttape {

// Bytes that reached nobody. They come by the piece and are told together.
class DropTally {
 public:
  struct Sum {
    std::uint64_t bytes = 0;
    std::string why;  // of the last piece
  };

  void add(std::uint64_t bytes, std::string_view why) {
    if (bytes == 0) return;  // no bytes have no reason
    sum_.bytes += bytes;
    sum_.why = why;
  }
  // What was added since the last call, if anything was.
  [[nodiscard]] std::optional<Sum> take() {
    if (sum_.bytes == 0) return std::nullopt;
    return std::exchange(sum_, {});
  }

 private:
  Sum sum_;
};

}  // namespace porttape
