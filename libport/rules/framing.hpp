#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// A frame at the front of some bytes.
struct FrameCut {
  enum class State : std::uint8_t {
    frame,
    more,  // it cannot be told before more has come
    none   // none begins here
  };
  State state = State::none;
  std::size_t size = 0;  // frame: its; none: so many bytes belong to none, at least one
  int format = -1;       // of the formats; -1: none

  friend bool operator==(const FrameCut&, const FrameCut&) = default;
};

// Where delimited frames end in some bytes. The places that it is asked for follow each other, so that each
// byte is searched once for each format, however many frames may begin there.
class DelimiterSearch {
 public:
  // Of the format of that number: where its first `end` at `from` or behind is over, if that is not behind
  // `to`. Neither of the two is before that of the last question about this format.
  std::optional<std::size_t> find(std::size_t format, ByteView end, ByteView bytes, std::size_t from,
                                  std::size_t to);

 private:
  struct Known {
    std::optional<std::size_t> begin{};
    std::size_t searched = 0;  // before it no other one begins, at what was asked for last or behind
  };
  std::vector<Known> known_;
};

// Cuts bytes that are all there into frames, from the front on. Refers to the formats.
class FrameCutter {
 public:
  explicit FrameCutter(std::span<const FrameFormat> formats) : formats_(formats) {}

  // Of the first of the formats that has a frame at `at`, which is in the bytes. They are the same ones each
  // time, and `at` is not before that of the last call. `ended`: nothing follows the bytes, or not before a
  // pause.
  FrameCut cut(ByteView bytes, std::size_t at, bool ended);

 private:
  std::span<const FrameFormat> formats_;
  DelimiterSearch ends_;
};

// Of this format alone. `ended`: nothing follows the bytes, or not before a pause.
FrameCut cut_frame(const FrameFormat& format, ByteView bytes, bool ended);

// Of the first of the formats that has one there; `bytes` is not empty.
FrameCut cut_frame(std::span<const FrameFormat> formats, ByteView bytes, bool ended);

// Known protocols: "nmea", "ubx", "modbus-rtu", …
std::span<const std::string_view> protocol_names();
// The formats of one, without a name of their own; empty: it is unknown.
std::vector<FrameFormat> protocol_formats(std::string_view protocol);

}  // namespace porttape
