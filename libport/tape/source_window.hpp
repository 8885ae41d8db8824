#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>

#include "libport/tape/byte_source.hpp"

namespace porttape {

// A source through one buffer, for looks that mostly go forward. Refers to the source.
class SourceWindow {
 public:
  static constexpr std::size_t kSize = std::size_t{256} * 1024;

  // `size`: of the buffer; small where looks jump.
  explicit SourceWindow(ByteSource& source, std::size_t size = kSize) : source_(&source), size_(size) {}

  // Whether these bytes are in the buffer: view() reads nothing then.
  [[nodiscard]] bool holds(std::uint64_t offset, std::size_t count) const {
    return buffer_ && offset >= begin_ && offset + count <= begin_ + filled_;
  }

  // The bytes from `offset` on, at most `most` of them and the buffer's size; fewer where the source ends.
  // Valid until the next call.
  Result<ByteView> view(std::uint64_t offset, std::size_t most) {
    most = std::min(most, size_);
    if (!holds(offset, most)) {
      if (!buffer_) buffer_ = std::make_unique_for_overwrite<Byte[]>(size_);
      const auto got = source_->read_at(offset, {buffer_.get(), size_});
      if (!got) return got.error();
      begin_ = offset;
      filled_ = *got;
    }
    const auto at = static_cast<std::size_t>(offset - begin_);
    return ByteView(buffer_.get() + at, std::min(most, filled_ - at));
  }

 private:
  ByteSource* source_;
  std::size_t size_;
  std::unique_ptr<Byte[]> buffer_;
  std::uint64_t begin_ = 0;
  std::size_t filled_ = 0;
};

}  // namespace porttape
