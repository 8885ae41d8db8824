#include "libport/port/port.hpp"

namespace porttape {

// A line that keeps nothing has sent all, and has no device that could be asked.
void Port::tell(const LineEvent& event) {
  if (const auto* drain = std::get_if<line::Drain>(&event)) {
    listener().told(line::Sent{drain->number});
  } else if (const auto* ask = std::get_if<line::Ask>(&event)) {
    listener().told(line::Answer{ask->number, std::nullopt});
  }
}

}  // namespace porttape
