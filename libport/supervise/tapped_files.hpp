#pragma once

#include <cstdint>
#include <memory>
#include <sys/types.h>
#include <utility>

#include "libport/base/tty_device.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/workers.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "libport/supervise/call.hpp"

namespace porttape {

// The device as a program has it: a duplicate of its descriptor.
class TappedFile {
 public:
  explicit TappedFile(UniqueFd fd) : fd_(std::move(fd)) {}

  [[nodiscard]] int fd() const { return fd_.get(); }
  // Whether the program's own calls wait there.
  [[nodiscard]] bool waits() const;
  // A watch on it, which ends before it is closed: the program has it open, so that its close would end none.
  struct Watch {
    std::shared_ptr<void> kept = {};
    std::uint64_t number = 0;
    bool armed = false;  // it tells of what comes
  };
  Watch& watch() { return watch_; }

 private:
  UniqueFd fd_;
  Watch watch_;
};

// While it lives nothing on that open file waits, neither here nor in a program that has it, too: some
// microseconds, for one call. A program's own look at the flags is made here (TapCalls) and does not meet it;
// a read of one that shares the file unseen may.
class WithoutWaiting {
 public:
  explicit WithoutWaiting(const TappedFile& file);
  ~WithoutWaiting();
  WithoutWaiting(const WithoutWaiting&) = delete;
  WithoutWaiting& operator=(const WithoutWaiting&) = delete;

  // Whether the program's calls wait there.
  [[nodiscard]] bool program_waits() const { return waits_; }

 private:
  int fd_;
  int flags_;
  bool waits_;
  bool changed_;
};

// The files of a program's own device that are read and written for it. While calls come one after the other,
// the duplicate that served the last one is kept (some ten milliseconds: a last close is to stay the
// program's own). Each time the kernel is asked whether the program still has it as that number: an execve
// may have closed it, or a thread that nobody has seen. Loop thread only.
class TappedFiles {
 public:
  explicit TappedFiles(Loop& loop);
  ~TappedFiles() { let_go(); }
  TappedFiles(const TappedFiles&) = delete;
  TappedFiles& operator=(const TappedFiles&) = delete;

  // What the call's thread has as `fd`, if that is `device`. Else nothing, and why: an error number, or 0
  // where it is another file.
  std::shared_ptr<TappedFile> find(const Call& call, int fd, const TtyDevice& device, int& error);

  // A file that is used no more. Of a program that has ended it may be the last one, whose close waits until
  // the device has sent everything: done elsewhere.
  void drop(std::shared_ptr<TappedFile> file);

  // Before a program changes what its descriptors are: nothing is kept then.
  void let_go();

 private:
  void look();

  Loop* loop_;
  Timer timer_;
  Workers::Strand closes_;
  std::shared_ptr<TappedFile> kept_;
  bool used_ = false;
};

}  // namespace porttape
