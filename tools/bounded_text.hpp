#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

namespace porttape {

// What a program wrote, as much as anybody reads: of more than kMost bytes the beginning and the end, with a
// line between them that says how much was left out. A plain value in bounded memory.
class BoundedText {
 public:
  static constexpr std::size_t kMost = std::size_t{64} * 1024;

  void add(std::string_view text) {
    const std::size_t room = kMost / 2 - std::min(head_.size(), kMost / 2);
    head_ += text.substr(0, room);
    if (text.size() <= room) return;
    tail_ += text.substr(room);
    if (tail_.size() <= kMost) return;
    left_out_ += tail_.size() - kMost / 2;
    tail_.erase(0, tail_.size() - kMost / 2);
  }

  [[nodiscard]] std::string text() const {
    if (left_out_ == 0) return head_ + tail_;
    return head_ + "\n... " + std::to_string(left_out_) + " bytes are left out here ...\n" + tail_;
  }

 private:
  std::string head_;
  std::string tail_;
  std::size_t left_out_ = 0;
};

}  // namespace porttape
