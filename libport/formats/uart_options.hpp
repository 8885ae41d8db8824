#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "libport/base/result.hpp"
#include "libport/line/line_settings.hpp"

namespace porttape {

// What is known of a captured UART: by --device and --bytes-at, else by the capture itself.
struct UartOptions {
  std::string rx;  // the channel that the driver receives; empty: not told
  std::string tx;
  SeenSettings line;
  bool inverted = false;

  // "rx=D0,tx=D1,databits=8,parity=even,stopbits=1,invert", each optional. Errc::usage.
  static Result<UartOptions> parse(std::string_view text);
};

}  // namespace porttape
