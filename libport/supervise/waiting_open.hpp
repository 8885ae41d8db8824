#pragma once

#include <functional>
#include <memory>
#include <sys/types.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/supervise/program_files.hpp"

namespace porttape {

// An open() that may wait for long (a tty for its carrier), done by a process of its own, so that the
// kernel's rules for it hold and nobody else waits. Destroyed before it is over, it is broken off. Loop
// thread only.
class WaitingOpen {
 public:
  // The file, or none and the errno. Called once, not by start(); it is not to be destroyed in it.
  using Done = std::function<void(UniqueFd file, int error)>;

  // Without O_CREAT and its like, O_NOCTTY and O_CLOEXEC. Nothing, and errno: no process is to be had.
  static std::unique_ptr<WaitingOpen> start(Loop& loop, const ProgramFile& file, int flags, Done done);
  ~WaitingOpen();
  WaitingOpen(const WaitingOpen&) = delete;
  WaitingOpen& operator=(const WaitingOpen&) = delete;

  [[nodiscard]] bool over() const { return !done_; }

 private:
  WaitingOpen(Loop& loop, pid_t process, UniqueFd line, Done done);
  void on_readable();

  pid_t process_;
  UniqueFd line_;
  Done done_;
  FdWatch watch_;
};

}  // namespace porttape
