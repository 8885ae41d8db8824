#pragma once

#include <fcntl.h>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>

#include "libport/base/tty_device.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A file that a supervised program names, for openat() and its like here. A relative name stays as it is and
// goes from a descriptor of its folder: with the folder's path before it, it might be longer than the kernel
// takes. A value.
struct ProgramFile {
  std::string path;
  std::shared_ptr<const UniqueFd> folder = {};  // nullptr: the path is absolute
  bool in_proc = false;                         // named by its place in /proc

  [[nodiscard]] int at() const { return folder ? folder->get() : AT_FDCWD; }
};

// Returns the file that the thread names as `path`, from its descriptor `folder` (or AT_FDCWD). Looks at no
// file. Where the folder is not to be had, nothing can be opened by what is returned.
ProgramFile program_file(pid_t thread, const std::string& path, int folder);

// Returns the same file by a name that means it here, too: what leads to the program's own descriptors
// (/dev/stdin, /dev/fd/N, /proc/self) has that process's number then. Follows links, and so may wait for a
// file system.
ProgramFile own_file(pid_t thread, const ProgramFile& file);

// Whether it leads through what names a process's own files (/proc/self/fd): another process's here. May
// wait.
bool leads_through_process(const ProgramFile& file);
// Returns the device that it is, if it is one. May wait.
std::optional<TtyDevice> tty_device_at(const ProgramFile& file);

// What a file of a supervised program is, as far as the kernel's cache of names tells it at once (openat2(2),
// RESOLVE_CACHED). A file system may be served by a supervised program, whose next call would wait for us:
// who answers calls waits for no file system.
struct QuickLook {
  bool known = false;                    // else only own_file() and tty_device_at() tell it, which may wait
  std::optional<TtyDevice> device = {};  // none: another kind of file, or none
};
QuickLook look_at_once(const ProgramFile& file);

// Whether a tty that the thread opens without O_NOCTTY becomes its controlling terminal.
bool gets_terminal(pid_t thread);

}  // namespace porttape
