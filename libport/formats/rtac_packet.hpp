#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <utility>

#include "libport/line/line_signal.hpp"

namespace porttape::rtac {

// A packet of LINKTYPE_RTAC_SERIAL: seconds and microseconds (big-endian, 4 bytes each), what happened, the
// state of the lines, two bytes for later, and the bytes that were sent (TX: by the driver) or received.
inline constexpr std::uint32_t kLinkType = 250;
inline constexpr std::size_t kHead = 12;

enum class What : std::uint8_t {
  status_change,
  tx_start,
  rx_start,
  tx_end,
  rx_end,
  data_lost,
  complete,
  framing_error,
  parity_error,
  break_event,
  overflow
};

inline constexpr std::uint8_t kCts = 0x01;
inline constexpr std::uint8_t kCd = 0x02;
inline constexpr std::uint8_t kDsr = 0x04;
inline constexpr std::uint8_t kRts = 0x08;
inline constexpr std::uint8_t kDtr = 0x10;
inline constexpr std::uint8_t kRi = 0x20;

inline constexpr std::array<std::pair<std::uint8_t, LineSignal::Name>, 6> kLines = {
    {{kCts, LineSignal::Name::cts},
     {kCd, LineSignal::Name::cd},
     {kDsr, LineSignal::Name::dsr},
     {kRts, LineSignal::Name::rts},
     {kDtr, LineSignal::Name::dtr},
     {kRi, LineSignal::Name::ri}}};

// What a comment of ours begins with. Of the section, and of the first packet: the tape's zero in
// microseconds since 1970, and the header line; of a packet: the event's line, the length of a block that is
// not the packet's bytes, and of those that follow, that they are of the same block. `and ` goes on with the
// comment before.
inline constexpr std::string_view kZeroComment = "porttape zero ";
inline constexpr std::string_view kHeaderComment = "porttape header ";
inline constexpr std::string_view kEventComment = "porttape event ";
inline constexpr std::string_view kLengthComment = "porttape length ";
inline constexpr std::string_view kMoreComment = "porttape more";
inline constexpr std::string_view kAndComment = "porttape and ";

}  // namespace porttape::rtac
