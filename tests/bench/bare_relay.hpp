#pragma once

#include <string>
#include <vector>

namespace porttape::bench {

// What any program must do that joins a device and a pty and keeps the bytes: wait, read, pass on, append a
// block to a file. Nothing is checked, told or recovered; the measure of what a recorder costs beyond it.
struct BareLine {
  std::string device;  // a tty
  std::string link;    // to the pty that it makes
  std::string tape;
};

// Relays, with one thread and one epoll set, until a signal ends the process.
[[noreturn]] void relay_bare(const std::vector<BareLine>& lines);

}  // namespace porttape::bench
