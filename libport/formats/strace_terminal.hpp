#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "libport/tape/event.hpp"

namespace porttape {

// What a driver's requests to its tty, as strace prints them, are on a tape: settings, where they change,
// flushes, modem lines, breaks. Begins anew with each open. A value.
class StraceTerminal {
 public:
  // `argument`: what stands behind the request: "{c_iflag=…}", "TCIOFLUSH", "[TIOCM_DTR]".
  std::vector<Event> events_of(std::string_view request, std::string_view argument);

 private:
  std::optional<SeenSettings> settings_;
};

}  // namespace porttape
