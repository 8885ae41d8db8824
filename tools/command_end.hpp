#pragma once

#include <string>

namespace porttape {

// "SIGSEGV (11)"
std::string signal_text(int number);

// How a command ended.
struct CommandEnd {
  int status = 0;
  int signal = 0;  // that ended it; 0: it ended by itself, with `status`

  // As a shell gives it: the status, or 128 + the signal.
  [[nodiscard]] int exit_code() const { return signal == 0 ? status : 128 + signal; }
  // "ended with status 1", "was ended by SIGSEGV (11)"
  [[nodiscard]] std::string text() const;

  friend bool operator==(const CommandEnd&, const CommandEnd&) = default;
};

}  // namespace porttape
