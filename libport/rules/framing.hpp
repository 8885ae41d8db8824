#pragma once

#include <cstddef>
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

// Of this format alone. `ended`: nothing follows the bytes, or not before a pause.
FrameCut cut_frame(const FrameFormat& format, ByteView bytes, bool ended);

// Of the first of the formats that has one there; `bytes` is not empty.
FrameCut cut_frame(std::span<const FrameFormat> formats, ByteView bytes, bool ended);

// Known protocols: "nmea", "ubx", "modbus-rtu", …
std::span<const std::string_view> protocol_names();
// The formats of one, without a name of their own; empty: it is unknown.
std::vector<FrameFormat> protocol_formats(std::string_view protocol);

}  // namespace porttape
