#include "libport/base/error.hpp"

namespace porttape {

int exit_status_of(Errc code) {
  switch (code) {
    case Errc::usage:
    case Errc::not_a_tape:
      return exit_status::kUsage;
    case Errc::device_missing:
    case Errc::device_lost:
      return exit_status::kDevice;
    case Errc::damaged_tape:
    case Errc::io:
      break;
  }
  return exit_status::kRuntime;
}

}  // namespace porttape
