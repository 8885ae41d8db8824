#pragma once

#include <string>
#include <system_error>
#include <utility>

namespace porttape {

// What kind of thing went wrong; decides the exit status (contract section 4) and nothing else.
enum class Errc {
  usage,           // an option, a value, a configuration, a path the user must change: exit 2
  not_a_tape,      // the file is no tape in any known layout: exit 2
  damaged_tape,    // a tape with damage other than a torn tail: exit 1
  io,              // the system refused something at run time: exit 1
  device_missing,  // the device is not there, busy, or no such thing can be opened: exit 6
  device_lost,     // the device went away while open: exit 6
};

// One line for a person: what, where, and what to do next.
struct Error {
  Errc code = Errc::io;
  std::string message;

  friend bool operator==(const Error&, const Error&) = default;
};

// The error of what went well: no message.
const Error& no_error();

// Exit statuses of both programs (contract section 4).
namespace exit_status {
inline constexpr int kPass = 0;
inline constexpr int kRuntime = 1;
inline constexpr int kUsage = 2;
inline constexpr int kDataMismatch = 3;
inline constexpr int kTimingMismatch = 4;
inline constexpr int kIncomplete = 5;
inline constexpr int kDevice = 6;
}  // namespace exit_status

int exit_status_of(Errc code);

// Of two exit statuses the one that says more of what went wrong. Of verdicts: what is wrong outranks what is
// missing, and that outranks what was late.
int worse_exit_status(int one, int other);

// "No such file or directory" for errno 2; thread-safe.
inline std::string errno_text(int error_number) { return std::generic_category().message(error_number); }

}  // namespace porttape
