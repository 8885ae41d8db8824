#pragma once

#include <algorithm>
#include <array>
#include <asm/termbits.h>
#include <cstdint>
#include <optional>
#include <sys/ioctl.h>

#include "libport/line/line_event.hpp"

namespace porttape {

// A request (ioctl) of a tty that is an event of its line, known by its argument alone: a TCFLSH is a flush.
// Under a port of ours and under a tap it has its place behind what the program has written before. A new one
// is its row here.
struct EventRequest {
  std::uint32_t request;
  // The kernel carries it out on a pty too, and so for a port of ours. Otherwise nothing is done there but to
  // tell of it, and an argument that makes no event is refused with EINVAL.
  bool pty_does_it;
  std::optional<LineEvent> (*event)(int argument);  // nothing: the kernel refuses that argument
};

inline std::optional<LineEvent> flushed_by(int queue) {
  switch (queue) {
    case TCIFLUSH:
      return line::Flush{FlushQueue::in};
    case TCOFLUSH:
      return line::Flush{FlushQueue::out};
    case TCIOFLUSH:
      return line::Flush{FlushQueue::both};
    default:
      return std::nullopt;
  }
}

inline constexpr std::array kEventRequests{
    EventRequest{.request = TCFLSH, .pty_does_it = true, .event = flushed_by},
};

// Null: it is none.
inline const EventRequest* event_request(std::uint32_t request) {
  const auto* const found = std::ranges::find(kEventRequests, request, &EventRequest::request);
  return found == kEventRequests.end() ? nullptr : found;
}

}  // namespace porttape
