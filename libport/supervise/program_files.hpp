#pragma once

#include <optional>
#include <string>
#include <sys/types.h>

#include "libport/base/tty_device.hpp"

namespace porttape {

// A path of a supervised program (`folder`: a descriptor of its, or AT_FDCWD) as it names the same file here.
// What names the program's own descriptors (/dev/stdin, /dev/fd/N, /proc/self) does so by its number. It
// follows links, and so may wait for a file system.
std::string path_here(pid_t thread, const std::string& path, int folder);

// What a path of a supervised program leads to, as far as the kernel's cache of names tells it at once
// (openat2(2), RESOLVE_CACHED). A file system may be served by a supervised program, whose next call would
// wait for us: who answers calls waits for no file system.
struct QuickLook {
  bool known = false;                    // else only path_here() and tty_device_at() tell it, which may wait
  std::optional<TtyDevice> device = {};  // none: another kind of file, or none
};
QuickLook look_at_once(pid_t thread, const std::string& path, int folder);

// Whether a tty that the thread opens without O_NOCTTY becomes its controlling terminal.
bool gets_terminal(pid_t thread);

}  // namespace porttape
