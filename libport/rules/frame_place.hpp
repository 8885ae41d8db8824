#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <re2/re2.h>

#include "libport/base/bytes.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// Where something stands in a frame: [begin, end).
struct FrameSpan {
  std::size_t begin = 0;
  std::size_t end = 0;

  [[nodiscard]] std::size_t size() const { return end - begin; }
  [[nodiscard]] ByteView of(ByteView frame) const { return frame.subspan(begin, size()); }
  friend bool operator==(const FrameSpan&, const FrameSpan&) = default;
};

// A position of a frame of `size` bytes, negative ones counted from its end; nothing: outside of it.
std::optional<std::size_t> position_in(std::size_t size, std::int64_t at);

// Where the place is in this frame, which is of `format`; nothing: nowhere. `capture`: its expression,
// compiled, where it has one.
std::optional<FrameSpan> locate(const Place& place, const re2::RE2* capture, const FrameFormat* format,
                                ByteView frame);

// What a regular expression of a rules file works on: bytes, no characters. It is one of `count` that are
// kept together: all of them take some 256 MiB at most.
re2::RE2::Options rule_expression_options(std::size_t count = 1);
inline re2::StringPiece as_piece(ByteView bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace porttape
