#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_event.hpp"
#include "libport/tape/payload_totals.hpp"
#include "libport/tape/tape_header.hpp"

namespace porttape {

inline constexpr std::size_t kMaxEventText = 4096;

// Who did it.
enum class Side : std::uint8_t { driver, device };

// The kinds of events, one struct each, as the table of FORMAT.md tells them: kName is the kind's name on the
// tape, the members are its keys. A key that is not there, or says what no version of this one writes, is
// nothing, false, 0 or "".
//
// A new kind is: its struct here and its place in Event; its keys in event.cpp, both ways; its row in
// FORMAT.md. Whoever acts on it asks for it by its type.
namespace event {

struct Open {
  static constexpr std::string_view kName = "open";
  friend bool operator==(const Open&, const Open&) = default;
};

struct Close {
  static constexpr std::string_view kName = "close";
  friend bool operator==(const Close&, const Close&) = default;
};

struct DeviceLost {
  static constexpr std::string_view kName = "device-lost";
  StrangerText why;
  bool hung_up = false;  // the driver's line broke with it
  friend bool operator==(const DeviceLost&, const DeviceLost&) = default;
};

struct DeviceBack {
  static constexpr std::string_view kName = "device-back";
  friend bool operator==(const DeviceBack&, const DeviceBack&) = default;
};

struct HalfClose {
  static constexpr std::string_view kName = "half-close";
  std::optional<Side> by;
  friend bool operator==(const HalfClose&, const HalfClose&) = default;
};

struct Zero {
  static constexpr std::string_view kName = "zero";
  TapeZero zero;
  friend bool operator==(const Zero&, const Zero&) = default;
};

struct Settings {
  static constexpr std::string_view kName = "settings";
  std::optional<Side> by;  // the device's own, or what the driver has set
  SeenSettings line;
  std::optional<SettingsOrder> order;
  friend bool operator==(const Settings&, const Settings&) = default;
};

struct Flush {
  static constexpr std::string_view kName = "flush";
  std::optional<FlushQueue> queue;
  friend bool operator==(const Flush&, const Flush&) = default;
};

// A modem line went on or off: dtr and rts are the driver's to change, the others the device's.
struct Modem {
  static constexpr std::string_view kName = "modem";
  std::optional<LineSignal::Name> line;  // never brk
  std::optional<bool> on;
  std::optional<Side> by;
  friend bool operator==(const Modem&, const Modem&) = default;
};

struct Break {
  static constexpr std::string_view kName = "break";
  std::optional<bool> on;
  std::optional<Side> by;
  friend bool operator==(const Break&, const Break&) = default;
};

// The driver waited until all that it had written was sent (tcdrain). The event's own time is the end of
// that.
struct Drain {
  static constexpr std::string_view kName = "drain";
  Micros took{};
  friend bool operator==(const Drain&, const Drain&) = default;
};

struct Mark {
  static constexpr std::string_view kName = "mark";
  StrangerText text;
  friend bool operator==(const Mark&, const Mark&) = default;
};

struct Gap {
  static constexpr std::string_view kName = "gap";
  std::uint64_t bytes = 0;       // of both directions together; 0: only events, or unknown
  std::optional<TapeTime> from;  // when it began; the event's own time is where the tape goes on
  StrangerText why;
  friend bool operator==(const Gap&, const Gap&) = default;
};

struct Fault {
  static constexpr std::string_view kName = "fault";
  LineFault fault;
  friend bool operator==(const Fault&, const Fault&) = default;
};

struct End {
  static constexpr std::string_view kName = "end";
  std::optional<PayloadTotals> read;  // what the r and w files hold; nothing where it does not say so
  std::optional<PayloadTotals> write;
  std::optional<std::uint64_t> events = {};  // XXH3 of all lines before this one, newlines included
  friend bool operator==(const End&, const End&) = default;
};

// A kind that this version does not know. Its keys are in the line only.
struct Unknown {
  StrangerText kind;
  friend bool operator==(const Unknown&, const Unknown&) = default;
};

}  // namespace event

using Event = std::variant<event::Unknown, event::Open, event::Close, event::DeviceLost, event::DeviceBack,
                           event::HalfClose, event::Zero, event::Settings, event::Flush, event::Modem,
                           event::Break, event::Drain, event::Mark, event::Gap, event::Fault, event::End>;

// An event in its place on a tape.
struct TapeEvent {
  TapeTime at{};
  Event what;
};

// A change of a line's signal as an event, and back; nothing where the event is another, or not all of it is
// known.
struct TapedSignal {
  Side by = Side::driver;
  LineSignal signal;

  friend bool operator==(const TapedSignal&, const TapedSignal&) = default;
};
Event signal_event(const TapedSignal& signal);
std::optional<TapedSignal> signal_of(const Event& event);

// What the driver or the device did on the line, as the event of a tape; nothing where no tape holds it, or
// not from that side.
struct TapedLineEvent {
  Side by = Side::driver;
  LineEvent what;
};
std::optional<Event> event_of(const TapedLineEvent& event);
// And back, with who did it, of the events that a replay tells or makes again: settings, flushes, signals.
// Nothing where the event is another, or it is not known who did it.
std::optional<TapedLineEvent> line_event_of(const Event& event);

// The kind's name on the tape. Refers to the event.
std::string_view name_of(const Event& event);

// A line of the events file, newline included; a long text is cut to kMaxEventText bytes. An `end` that tells
// a digest of the lines before it is sealed: its last key is a digest of what stands before that in the line.
std::string encode(TapeTime at, const Event& event);
std::string encode(const TapeHeader& header);
// A line (without its newline) that was decoded, at another time; with its newline. Keys that this version
// does not know stay. A gap's begin moves with it. An `end` loses its digest of the lines before it.
std::string encode_again(std::string_view line, TapeTime at);
// The same, of an event that tells what held before the tape's beginning.
std::string encode_carried(std::string_view line, TapeTime at);
bool is_carried(std::string_view line);
// A header's line (without its newline) with `created`, `id`, `zero`, `previous` and `origin` of another;
// with its newline. Keys that this version does not know stay. Where `line` is no header: the other one.
std::string encode_again(std::string_view line, const TapeHeader& changed);

// A line without its newline. Unknown kinds and keys are no error. The error's message says what is wrong
// with the line, without its file and number: Errc::damaged_tape; a header of another version:
// Errc::not_a_tape, as in "an events file of version 2".
Result<TapeEvent> decode_event(std::string_view line);
// Whether a line (without its newline) that was decoded to `event` is as it was written, as far as it tells
// that. Errc::damaged_tape with a message as above.
Result<void> check_seal(std::string_view line, const Event& event);
Result<TapeHeader> decode_header(std::string_view line);

}  // namespace porttape
