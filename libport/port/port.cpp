#include "libport/port/port.hpp"

namespace porttape {

// A line that keeps nothing has sent all, and has no device that could be asked.
void Port::tell(const LineEvent& event) {
  if (const auto answer = answer_without_device(event)) listener().told(*answer);
}

}  // namespace porttape
