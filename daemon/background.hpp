#pragma once

#include <optional>
#include <string>

#include "libport/base/result.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// The program in the background: the caller's process waits until the child is ready or has failed. Use
// before any thread is started.
class Background {
 public:
  // Forks. In the caller's process: the status to exit with, once the child is ready (0) or has ended. In the
  // child: nothing.
  Result<std::optional<int>> start();

  // In the child: lets the caller's process return, and gives up its terminal. Nothing to do when start() was
  // not called.
  void ready();

 private:
  UniqueFd to_parent_;
};

// A file with the process's number, locked while the process lives. The destructor removes it, unless its
// name means another file by then. Errc::usage: another process holds it, the file is not a pidfile, or
// another user's link leads to its folder.
class PidFile {
 public:
  PidFile() = default;
  ~PidFile();
  PidFile(const PidFile&) = delete;
  PidFile& operator=(const PidFile&) = delete;

  Result<void> write(const std::string& path);

 private:
  Result<bool> try_to_take(const std::string& path);

  UniqueFd fd_;
  TrustedName place_;
};

}  // namespace porttape
