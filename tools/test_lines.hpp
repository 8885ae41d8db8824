#pragma once

#include <string>

#include "tools/verbs.hpp"

namespace porttape {

// The command lines that a report of `porttape test` ends with, as a POSIX shell reads them; `args` are those
// behind `test`.
std::string repeat_line(Arguments args);
// The same with a debugger in front of the command (gdb for a program, pdb for Python, `-x` for a shell's
// script), and without a limit of time.
std::string step_line(Arguments args);

}  // namespace porttape
