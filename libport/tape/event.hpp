#pragma once

#include <array>
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

// What the driver or the device did on the line.
struct TapedLineEvent {
  Side by = Side::driver;
  LineEvent what;
};

// The kinds of events, one struct each, as the table of FORMAT.md tells them: kName is the kind's name on the
// tape, the members are its keys. A key that is not there, or says what no version of this one writes, is
// nothing, false, 0 or "".
//
// keys() names the members to whoever writes, reads or lists the format (event_keys.hpp). of() makes the
// event of what happened on the line; nothing where no tape holds it from that side. line_event() is the way
// back, of those that a replay tells or makes again; nothing where it is not known who did it.
//
// A new kind is its struct here, its place in Event and its row in FORMAT.md. Whoever acts on it asks for it
// by its type.
namespace event {

// The values that are words on the tape; the place is the value.
inline constexpr auto kSides = std::to_array<std::string_view>({"driver", "device"});
inline constexpr auto kDirs = std::to_array<std::string_view>({"r", "w"});
inline constexpr auto kQueues = std::to_array<std::string_view>({"in", "out", "both"});
inline constexpr auto kOrders = std::to_array<std::string_view>({"exact", "sampled"});
inline constexpr auto kStates = std::to_array<std::string_view>({"off", "on"});
inline constexpr auto kModemLines = std::to_array<std::string_view>({"dtr", "rts", "cts", "dsr", "cd", "ri"});
// Those that this version makes.
inline constexpr auto kFaults = std::to_array<std::string_view>(
    {"drop", "corrupt", "duplicate", "delay", "stall", "truncate", "hangup", "replug", "plan", "more"});

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

  static void keys(auto& lost, auto& keys) {
    keys.text("why", lost.why);
    keys.flag("hung_up", lost.hung_up);
  }
  friend bool operator==(const DeviceLost&, const DeviceLost&) = default;
};

struct DeviceBack {
  static constexpr std::string_view kName = "device-back";
  friend bool operator==(const DeviceBack&, const DeviceBack&) = default;
};

struct HalfClose {
  static constexpr std::string_view kName = "half-close";
  std::optional<Side> by;

  static void keys(auto& half_close, auto& keys) { keys.word("by", half_close.by, kSides); }
  friend bool operator==(const HalfClose&, const HalfClose&) = default;
};

struct Zero {
  static constexpr std::string_view kName = "zero";
  TapeZero zero;

  static void keys(auto& event, auto& keys) { keys.members(event.zero); }
  friend bool operator==(const Zero&, const Zero&) = default;
};

struct Settings {
  static constexpr std::string_view kName = "settings";
  std::optional<Side> by;  // the device's own, or what the driver has set
  SeenSettings line;
  std::optional<SettingsOrder> order;

  static void keys(auto& settings, auto& keys) {
    keys.word("by", settings.by, kSides);
    keys.members(settings.line);
    keys.word("order", settings.order, kOrders);
  }
  static std::optional<Settings> of(Side by, const line::Settings& made) {
    return Settings{by, made.seen, made.order};
  }
  [[nodiscard]] std::optional<TapedLineEvent> line_event() const {
    if (!by) return std::nullopt;
    return TapedLineEvent{*by, line::Settings{line, order.value_or(SettingsOrder::exact)}};
  }
  friend bool operator==(const Settings&, const Settings&) = default;
};

struct Flush {
  static constexpr std::string_view kName = "flush";
  std::optional<FlushQueue> queue;

  static void keys(auto& flush, auto& keys) { keys.word("queue", flush.queue, kQueues); }
  static std::optional<Flush> of(Side by, const line::Flush& made) {
    return by == Side::driver ? std::optional(Flush{made.queue}) : std::nullopt;
  }
  [[nodiscard]] std::optional<TapedLineEvent> line_event() const {
    return TapedLineEvent{Side::driver, line::Flush{queue.value_or(FlushQueue::both)}};
  }
  friend bool operator==(const Flush&, const Flush&) = default;
};

// A modem line went on or off: dtr and rts are the driver's to change, the others the device's.
struct Modem {
  static constexpr std::string_view kName = "modem";
  std::optional<LineSignal::Name> line;  // never brk
  std::optional<bool> on;
  std::optional<Side> by;

  static void keys(auto& modem, auto& keys) {
    keys.word("line", modem.line, kModemLines);
    keys.word("state", modem.on, kStates);
    keys.word("by", modem.by, kSides);
  }
  static std::optional<Modem> of(Side by, const LineSignal& made) {
    return made.name != LineSignal::Name::brk ? std::optional(Modem{made.name, made.on, by}) : std::nullopt;
  }
  [[nodiscard]] std::optional<TapedLineEvent> line_event() const {
    if (!line || !on) return std::nullopt;
    return TapedLineEvent{by.value_or(is_output(*line) ? Side::driver : Side::device),
                          LineSignal{*line, *on}};
  }
  friend bool operator==(const Modem&, const Modem&) = default;
};

struct Break {
  static constexpr std::string_view kName = "break";
  std::optional<bool> on;
  std::optional<Side> by;

  static void keys(auto& signal, auto& keys) {
    keys.word("state", signal.on, kStates);
    keys.word("by", signal.by, kSides);
  }
  static std::optional<Break> of(Side by, const LineSignal& made) {
    return made.name == LineSignal::Name::brk ? std::optional(Break{made.on, by}) : std::nullopt;
  }
  [[nodiscard]] std::optional<TapedLineEvent> line_event() const {
    if (!on) return std::nullopt;
    return TapedLineEvent{by.value_or(Side::driver), LineSignal{LineSignal::Name::brk, *on}};
  }
  friend bool operator==(const Break&, const Break&) = default;
};

// The driver waited until all that it had written was sent (tcdrain). The event's own time is the end of
// that.
struct Drain {
  static constexpr std::string_view kName = "drain";
  Micros took{};

  static void keys(auto& drain, auto& keys) { keys.number("took_us", drain.took); }
  friend bool operator==(const Drain&, const Drain&) = default;
};

struct Mark {
  static constexpr std::string_view kName = "mark";
  StrangerText text;

  static void keys(auto& mark, auto& keys) { keys.text("text", mark.text); }
  static std::optional<Mark> of(Side, const line::Mark& made) { return Mark{made.text}; }
  friend bool operator==(const Mark&, const Mark&) = default;
};

struct Gap {
  static constexpr std::string_view kName = "gap";
  std::uint64_t bytes = 0;       // of both directions together; 0: only events, or unknown
  std::optional<TapeTime> from;  // when it began; the event's own time is where the tape goes on
  StrangerText why;

  static void keys(auto& gap, auto& keys) {
    keys.number("bytes", gap.bytes);
    keys.moment("from_us", gap.from);
    keys.text("why", gap.why);
  }
  static std::optional<Gap> of(Side by, const line::Dropped& lost) {
    if (by == Side::driver) return std::nullopt;
    return Gap{lost.bytes, std::nullopt, std::string(lost.why)};
  }
  friend bool operator==(const Gap&, const Gap&) = default;
};

struct Fault {
  static constexpr std::string_view kName = "fault";
  LineFault fault;

  static void keys(auto& event, auto& keys) {
    auto& fault = event.fault;
    keys.text("kind", fault.kind, kFaults);
    keys.word("dir", fault.dir, kDirs);
    keys.number("offset", fault.offset);
    keys.number_if("count", fault.count);
    keys.text_if("spec", fault.spec);
    keys.number("seed", fault.seed);
  }
  static std::optional<Fault> of(Side by, const LineFault& made) {
    return by == Side::driver ? std::nullopt : std::optional(Fault{made});
  }
  friend bool operator==(const Fault&, const Fault&) = default;
};

struct End {
  static constexpr std::string_view kName = "end";
  std::optional<PayloadTotals> read;  // what the r and w files hold; nothing where it does not say so
  std::optional<PayloadTotals> write;
  std::optional<std::uint64_t> events = {};  // XXH3 of all lines before this one, newlines included

  static constexpr std::string_view kEventsDigest = "events_xxh3";
  static void keys(auto& end, auto& keys) {
    keys.object("read", end.read);
    keys.object("write", end.write);
    keys.digest(kEventsDigest, end.events);
  }
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

// What the driver or the device did on the line, as the event of a tape; nothing where no tape holds it, or
// not from that side.
std::optional<Event> event_of(const TapedLineEvent& event);
// And back, with who did it, of the events that a replay tells or makes again: settings, flushes, signals.
// Nothing where the event is another, or it is not known who did it.
std::optional<TapedLineEvent> line_event_of(const Event& event);

// The same of a change of a line's signal.
struct TapedSignal {
  Side by = Side::driver;
  LineSignal signal;

  friend bool operator==(const TapedSignal&, const TapedSignal&) = default;
};
Event signal_event(const TapedSignal& signal);
std::optional<TapedSignal> signal_of(const Event& event);

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
