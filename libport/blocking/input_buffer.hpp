#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "libport/base/bytes.hpp"

namespace porttape {

// What has come in and was not read yet. Remembers where messages end when told to. Not thread-safe.
class InputBuffer {
 public:
  // `message`: the bytes are one, and front_size() is not to reach beyond it.
  void append(ByteView data, bool message);
  void consume(std::size_t count);
  void clear();

  [[nodiscard]] std::size_t size() const { return bytes_.size() - begin_; }
  [[nodiscard]] bool empty() const { return size() == 0; }
  [[nodiscard]] ByteView view() const { return ByteView(bytes_).subspan(begin_); }
  // Bytes that one read may give: all, or what is left of the first message.
  [[nodiscard]] std::size_t front_size() const;
  // Bytes that consume() and clear() have taken away so far: offsets from before a change mean nothing after
  // it.
  [[nodiscard]] std::uint64_t removed() const { return removed_; }
  // Where the first such byte stands, looking from `from` on.
  [[nodiscard]] std::optional<std::size_t> find(Byte wanted, std::size_t from = 0) const;

 private:
  Bytes bytes_;
  std::size_t begin_ = 0;
  std::uint64_t removed_ = 0;
  std::deque<std::size_t> messages_;  // sizes of what is left of them
};

}  // namespace porttape
