#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/tape/event.hpp"

namespace porttape {

// What a driver's requests to its tty, as strace prints them, are on a tape: settings, where they change,
// flushes, modem lines, breaks. Begins anew with each open. A value.
class StraceTerminal {
 public:
  struct Asked {
    std::vector<Event> events{};
    std::string problem{};  // with the line; empty: none
  };
  // `argument`: what stands behind the request: "{c_iflag=…}", "TCIOFLUSH", "[TIOCM_DTR]".
  Asked asked(std::string_view request, std::string_view argument);

 private:
  Asked set(std::string_view request, std::string_view argument);

  std::optional<SeenSettings> settings_;
};

}  // namespace porttape
