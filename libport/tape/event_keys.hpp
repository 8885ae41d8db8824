#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <string_view>
#include <type_traits>

#include "libport/base/port_identity.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/tape/event.hpp"

namespace porttape {

// The keys of the events file, told once: the order of a line's keys, their types, and which of their texts
// are the format's own. Each function here, and keys() of each kind of event, tells the members of a value to
// `keys`, which writes them, reads them, or lists them:
//
//   text(key, value)          always written; text_if: unless it is empty. A third argument says which texts
//                             are the format's: a list of words, or a function that knows their form
//   word(key, value, words)   an optional value that is one of the words
//   number(key, value)        a whole number of any integer type (or microseconds) that is not negative,
//                             optional or not; number_if: unless it is 0
//   number(key, value, least, most)
//   needed(key, value)        a number without which the object counts as not there
//   flag(key, value)          a bool, written where it is true; an optional one where it is known
//   moment(key, value)        an optional time on the tape
//   digest(key, value)        an optional XXH3
//   usb_id(key, value)        an optional number of four hexadecimal digits
//   object(key, value)        an optional value with keys of its own, as a JSON object
//   list(key, values)         several of them
//   members(value)            its keys, without an object around them
namespace event_keys {

using Words = std::span<const std::string_view>;
// Whether a text has a form of the format's.
using Form = bool (*)(std::string_view text);
bool is_id(std::string_view text);
bool is_digest(std::string_view text);
bool is_wall_time(std::string_view text);  // RFC 3339, in whatever precision
bool is_boot(std::string_view text);

inline constexpr auto kFormats = std::to_array<std::string_view>({"porttape-events"});
inline constexpr auto kTransports = std::to_array<std::string_view>({"stream", "datagram"});
inline constexpr auto kStamped = std::to_array<std::string_view>({"arrival", "read"});
inline constexpr auto kMakingVerbs =
    std::to_array<std::string_view>({"cut", "split", "merge", "recover", "redact", "convert", "shrink"});

template <class Told, class Value>
concept Tells = std::is_same_v<std::remove_const_t<Told>, Value>;

void tell(Tells<TapeZero> auto& zero, auto& keys) {
  keys.text("wall", zero.wall, is_wall_time);
  keys.number("monotonic_us", zero.monotonic_us);
  keys.text_if("boot", zero.boot, is_boot);
}

void tell(Tells<SeenSettings> auto& settings, auto& keys) {
  keys.number("baud", settings.baud, 0, std::numeric_limits<unsigned>::max());
  keys.number("databits", settings.data_bits, 5, 8);
  keys.word("parity", settings.parity, kParityWords);
  keys.number("stopbits", settings.stop_bits, 1, 2);
  keys.flag("hwflowctrl", settings.hw_flow);
  keys.flag("swflowctrl", settings.sw_flow);
}

void tell(Tells<PayloadTotals> auto& totals, auto& keys) {
  keys.needed("blocks", totals.blocks);
  keys.needed("bytes", totals.bytes);
  keys.digest("xxh3", totals.xxh3);
  keys.digest("xxh3_all", totals.xxh3_all);
}

void tell(Tells<PortIdentity> auto& port, auto& keys) {
  keys.text("path", port.path);
  keys.usb_id("vid", port.vid);
  keys.usb_id("pid", port.pid);
  keys.text_if("serial", port.serial);
  keys.text_if("manufacturer", port.manufacturer);
  keys.text_if("product", port.product);
  keys.number("interface", port.interface, 0, 255);
  keys.text_if("driver", port.driver);
}

void tell(Tells<PreviousTape> auto& tape, auto& keys) {
  keys.text_if("id", tape.id, is_id);
  keys.text("name", tape.name);
}

void tell(Tells<TapeOrigin> auto& origin, auto& keys) {
  keys.text("by", origin.by, kMakingVerbs);
  keys.list("tapes", origin.tapes);
  keys.number("from_us", origin.from);
}

void tell(Tells<TapeHeader> auto& header, auto& keys) {
  keys.text("created", header.created, is_wall_time);
  keys.text_if("id", header.id, is_id);
  keys.object("zero", header.zero);
  keys.text("device", header.device);
  keys.text("driver", header.driver);
  keys.word("transport", header.transport, kTransports);
  keys.word("stamped", header.stamped, kStamped);
  keys.object("previous", header.previous);
  keys.object("identity", header.identity);
  keys.object("origin", header.origin);
  keys.text("host", header.host);
  keys.text("tool", header.tool);
}

// A kind of event.
template <class Kind>
void tell(Kind& kind, auto& keys) requires requires {
  Kind::kName;
}
{
  if constexpr (!std::is_empty_v<Kind>) Kind::keys(kind, keys);
}

}  // namespace event_keys
}  // namespace porttape
