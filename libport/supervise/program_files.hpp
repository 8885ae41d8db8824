#pragma once

#include <string>
#include <sys/types.h>

namespace porttape {

// A path of a supervised program (`folder`: a descriptor of its, or AT_FDCWD) as it names the same file here.
// What names the program's own descriptors (/dev/stdin, /dev/fd/N, /proc/self) does so by its number.
std::string path_here(pid_t thread, const std::string& path, int folder);

// Whether a tty that the thread opens without O_NOCTTY becomes its controlling terminal.
bool gets_terminal(pid_t thread);

}  // namespace porttape
