#include "tools/command_end.hpp"

#include <cstring>
#include <fmt/format.h>

namespace porttape {

std::string signal_text(int number) {
  const char* name = ::sigabbrev_np(number);
  return name != nullptr ? fmt::format("SIG{} ({})", name, number) : fmt::format("signal {}", number);
}

// A shell gives 128 + N for a program of its own that signal N ended.
std::string CommandEnd::text() const {
  if (signal != 0) return "was ended by " + signal_text(signal);
  const bool of_shell = status > 128 && ::sigabbrev_np(status - 128) != nullptr;
  return fmt::format("ended with status {}{}", status,
                     of_shell ? fmt::format(", a shell's for {}", signal_text(status - 128)) : "");
}

}  // namespace porttape
