#pragma once

#include <cstdint>
#include <memory>
#include <sys/types.h>
#include <utility>

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
  // Whether the program's own calls wait there. Known once TappedFiles::use() was called.
  [[nodiscard]] bool waits() const { return waits_; }
  // A watch on it, which ends before it is closed: the program has it open, so that its close would end none.
  std::shared_ptr<void>& watch() { return watch_; }

 private:
  friend class TappedFiles;
  void begin();
  void restore();

  UniqueFd fd_;
  int flags_ = -1;
  bool waits_ = false;
  bool changed_ = false;
  std::shared_ptr<void> watch_;
};

// The files of a program's own device that are read and written for it. While calls come one after the other,
// the duplicate that served the last one is kept (some ten milliseconds: a last close is to stay the
// program's own), and what was made of its flags. Loop thread only.
class TappedFiles {
 public:
  explicit TappedFiles(Loop& loop);
  ~TappedFiles() { let_go(); }
  TappedFiles(const TappedFiles&) = delete;
  TappedFiles& operator=(const TappedFiles&) = delete;

  // What the call's thread has as `fd`, if that is `device`. Else nothing, and why: an error number, or 0
  // where it is another file.
  std::shared_ptr<TappedFile> find(const Call& call, int fd, std::uint64_t device, int& error);

  // From now on nothing on that open file waits, neither here nor in a program, until restore(). The
  // program's calls that would notice are made here, one after the other.
  void use(const std::shared_ptr<TappedFile>& file);
  void restore();

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
  std::shared_ptr<TappedFile> changed_;  // whose calls do not wait now
  pid_t thread_ = 0;
  int number_ = -1;
  bool used_ = false;
};

}  // namespace porttape
