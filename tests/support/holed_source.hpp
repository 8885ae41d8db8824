#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <utility>

#include "libport/tape/byte_source.hpp"

namespace porttape::test {

// A huge file of which only some pieces were ever written, and how much of it was read.
class HoledSource final : public ByteSource {
 public:
  struct Read {
    std::uint64_t calls = 0;
    std::uint64_t bytes = 0;
  };

  // `read` must outlive it.
  HoledSource(Read& read, std::uint64_t size, std::map<std::uint64_t, Bytes> pieces)
      : read_(read), size_(size), pieces_(std::move(pieces)) {}

  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    const std::size_t got =
        static_cast<std::size_t>(std::min<std::uint64_t>(into.size(), size_ - std::min(size_, offset)));
    std::ranges::fill(into, Byte{0});
    for (const auto& [begin, bytes] : pieces_) {
      const std::uint64_t from = std::max(begin, offset);
      const std::uint64_t to = std::min(begin + bytes.size(), offset + got);
      if (from < to)
        std::ranges::copy(std::span(bytes).subspan(from - begin, to - from),
                          into.subspan(from - offset).begin());
    }
    ++read_.calls;
    read_.bytes += got;
    return got;
  }
  Result<std::uint64_t> size() override { return size_; }
  Stretch stored(std::uint64_t offset) override {
    for (const auto& [begin, bytes] : pieces_)
      if (offset < begin + bytes.size()) return {std::max(begin, offset), begin + bytes.size()};
    return {size_, size_};
  }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  Read& read_;
  std::string name_ = "holed";
  std::uint64_t size_;
  std::map<std::uint64_t, Bytes> pieces_;
};

}  // namespace porttape::test
