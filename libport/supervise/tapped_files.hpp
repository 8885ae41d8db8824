#pragma once

#include <cstdint>
#include <memory>
#include <sys/types.h>
#include <utility>

#include "libport/base/tty_device.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/workers.hpp"
#include "libport/loop/loop.hpp"
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
  friend class TappedFiles;

  UniqueFd fd_;
  Watch watch_;
  unsigned users_ = 0;  // calls that are being done on it
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

// The files of a program's own device that are read and written for it. A duplicate lives as long as the
// calls that are done on it, and is closed before the last of them is answered: the program's next call may
// be the device's last close, which has to be the program's own (it waits until everything is sent, and
// lowers DTR). Loop thread only.
class TappedFiles {
 public:
  explicit TappedFiles(Loop& loop) : loop_(&loop) {}

  // Returns what the call has as its first argument, if that is `device`. Else returns nullptr and sets
  // `error` to an error number, and leaves it alone where it is another file. The file does not outlive this.
  std::shared_ptr<TappedFile> find(const Call& call, const TtyDevice& device, int& error);

  // Called once for each file that find() gave, when its call is about to be answered or is over. A call that
  // ends otherwise lets go by its last reference.
  void let_go(const Call& call, TappedFile& file);

 private:
  // For a file that its program may have closed: the close may wait until the device has sent everything.
  void close_elsewhere(UniqueFd file);

  Loop* loop_;
  Workers::Strand closes_;
  std::weak_ptr<TappedFile> last_;  // that was found
};

}  // namespace porttape
