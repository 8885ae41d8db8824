#include "libport/base/error.hpp"

#include <algorithm>
#include <array>

namespace porttape {

const Error& no_error() {
  static const Error none;
  return none;
}

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

int worse_exit_status(int one, int other) {
  constexpr std::array order = {exit_status::kPass,       exit_status::kTimingMismatch,
                                exit_status::kIncomplete, exit_status::kDataMismatch,
                                exit_status::kDevice,     exit_status::kUsage,
                                exit_status::kRuntime};
  return std::ranges::find(order, one) < std::ranges::find(order, other) ? other : one;
}

}  // namespace porttape
