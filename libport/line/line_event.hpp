#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "libport/line/line_fault.hpp"
#include "libport/line/line_request.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/line/line_signal.hpp"

namespace porttape {

// Which bytes a flush drops, as the one who flushes sees them.
enum class FlushQueue : std::uint8_t { in, out, both };

// Joins a request that waits to its answer. The port whose peer asks gives each request another one.
using RequestNumber = std::uint64_t;

// What can happen on a line besides bytes, coming up, going down, an end of writing and back-pressure. "The
// peer" is the program or the device at the end of the line where it happened.
namespace line {

// The peer dropped bytes of its own line (tcflush): what had come to it and was not read, what it had written
// and was not sent, or both.
struct Flush {
  FlushQueue queue = FlushQueue::in;
  friend bool operator==(const Flush&, const Flush&) = default;
};

// The peer has its line so now, as far as that is seen.
struct Settings {
  SeenSettings seen;
  SettingsOrder order = SettingsOrder::exact;
  friend bool operator==(const Settings&, const Settings&) = default;
};

// The peer waits until all that it wrote before has left for the other end. Sent answers it, once.
struct Drain {
  RequestNumber number = 0;
  friend bool operator==(const Drain&, const Drain&) = default;
};
struct Sent {
  RequestNumber number = 0;
  friend bool operator==(const Sent&, const Sent&) = default;
};

// The peer asks what only the device at the other end can answer, behind all that it wrote, set and signalled
// before. Answer answers it, once.
struct Ask {
  RequestNumber number = 0;
  LineRequest request;
};
struct Answer {
  RequestNumber number = 0;
  std::optional<LineAnswer> answer;  // nothing: there is no serial device that could be asked
};

// The peer has gone and left so many bytes unread; nothing: its line, which tells it otherwise, could not be
// seen. The end of the line follows.
struct LeftUnread {
  std::optional<std::uint64_t> bytes;
  friend bool operator==(const LeftUnread&, const LeftUnread&) = default;
};

// Another peer came while one was there, and was turned away with so many bytes that it had written.
struct Refused {
  std::uint64_t bytes = 0;
  friend bool operator==(const Refused&, const Refused&) = default;
};

// So many bytes, taken to be written or come from the peer, reached nobody. Valid during the call that tells
// it.
struct Dropped {
  std::uint64_t bytes = 0;
  std::string_view why;
  friend bool operator==(const Dropped&, const Dropped&) = default;
};

// Somebody who looks on has this to say of the line at this moment.
struct Mark {
  std::string text;
  friend bool operator==(const Mark&, const Mark&) = default;
};

// Signals that the device drives are to be told from now on, or not any more; at any time. Where they are,
// and the line has such signals, they are told when it comes up (or is resumed), before any bytes, and
// whenever they change.
struct WatchSignals {
  bool on = true;
  friend bool operator==(const WatchSignals&, const WatchSignals&) = default;
};

}  // namespace line

// One of them. LineSignal: the peer has changed a signal of the line; of a device also how each of its own
// stands when the line comes up. LineFault: a wrapper has done this to the line on purpose; the bytes
// concerned come next, if any do.
//
// A new kind is its struct here, the port that tells it, and whoever acts on it. Wrappers, queues and
// sessions pass on all kinds; tapes hold, and play, those that event_of() and line_event_of() of
// tape/event.hpp name.
using LineEvent =
    std::variant<line::Flush, line::Settings, LineSignal, line::Drain, line::Sent, line::Ask, line::Answer,
                 line::LeftUnread, line::Refused, line::Dropped, LineFault, line::Mark, line::WatchSignals>;

// What std::visit needs: one function for each kind that matters, and one for all others.
template <class... Functions>
struct LineVisitor : Functions... {
  using Functions::operator()...;
};
template <class... Functions>
LineVisitor(Functions...) -> LineVisitor<Functions...>;

// What answers a request where there is no device that could; std::nullopt for an event that is no request.
inline std::optional<LineEvent> answer_without_device(const LineEvent& event) {
  if (const auto* drain = std::get_if<line::Drain>(&event)) return line::Sent{drain->number};
  if (const auto* ask = std::get_if<line::Ask>(&event)) return line::Answer{ask->number, std::nullopt};
  return std::nullopt;
}

// Whether the event has its place among the bytes. A port that holds bytes back reports the others at once:
// losses, faults, what a peer that has gone left behind, answers, and what a session wants to know.
inline bool keeps_place(const LineEvent& event) {
  return std::visit(LineVisitor{
                        [](const line::Sent&) { return false; },
                        [](const line::Answer&) { return false; },
                        [](const line::LeftUnread&) { return false; },
                        [](const line::Refused&) { return false; },
                        [](const line::Dropped&) { return false; },
                        [](const LineFault&) { return false; },
                        [](const line::WatchSignals&) { return false; },
                        [](const auto&) { return true; },
                    },
                    event);
}

}  // namespace porttape
