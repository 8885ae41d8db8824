#pragma once

#include <cstdint>
#include <string_view>

namespace porttape {

// Whose bytes a run holds against the tape: the driver's, where the tape plays the device; or the device's,
// where the tape plays the driver (`drive`).
enum class Writer : std::uint8_t { driver, device };

// The words of a report for them: all that it says of either comes from here.
struct Roles {
  std::string_view name;   // "driver", as JSON has it
  std::string_view one;    // who is judged
  std::string_view wrote;  // what that one did
  std::string_view write;  // one of these
  std::string_view writes;
  std::string_view request;  // what it wrote in one exchange
  std::string_view answer;   // what it got for that, from …
  std::string_view other;    // … whom the tape plays
  std::string_view open;     // what times are counted from
};

constexpr Roles roles_of(Writer writer) {
  if (writer == Writer::device)
    return {.name = "device",
            .one = "the device",
            .wrote = "sent",
            .write = "piece",
            .writes = "answers",
            .request = "answer",
            .answer = "request",
            .other = "the driver",
            .open = "the open"};
  return {.name = "driver",
          .one = "the driver",
          .wrote = "wrote",
          .write = "write",
          .writes = "writes",
          .request = "request",
          .answer = "answer",
          .other = "the device",
          .open = "its open"};
}

}  // namespace porttape
