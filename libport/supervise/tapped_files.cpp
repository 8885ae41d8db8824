#include "libport/supervise/tapped_files.hpp"

#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <sys/stat.h>
#include <utility>

namespace porttape {
namespace {

constexpr Nanos kUnused = std::chrono::milliseconds(10);

}  // namespace

void TappedFile::begin() {
  if (changed_) return;
  flags_ = ::fcntl(fd_.get(), F_GETFL);
  waits_ = flags_ >= 0 && (flags_ & O_NONBLOCK) == 0;
  changed_ = waits_ && ::fcntl(fd_.get(), F_SETFL, flags_ | O_NONBLOCK) == 0;
}

void TappedFile::restore() {
  if (std::exchange(changed_, false)) ::fcntl(fd_.get(), F_SETFL, flags_);
}

TappedFiles::TappedFiles(Loop& loop) : loop_(&loop), timer_(loop, [this] { look(); }) {}

std::shared_ptr<TappedFile> TappedFiles::find(const Call& call, int fd, std::uint64_t device, int& error) {
  error = 0;
  used_ = true;
  if (kept_ && thread_ == call.thread() && number_ == fd) return kept_;
  UniqueFd file = call.duplicate(fd);
  if (!file) {
    error = errno;
    return nullptr;
  }
  struct stat status {};
  if (::fstat(file.get(), &status) != 0 || !S_ISCHR(status.st_mode) || status.st_rdev != device)
    return nullptr;
  let_go();
  kept_ = std::make_shared<TappedFile>(std::move(file));
  thread_ = call.thread();
  number_ = fd;
  timer_.set_after(kUnused);
  return kept_;
}

// Two files may be the same open one: the flags of that are read while they are the program's.
void TappedFiles::use(const std::shared_ptr<TappedFile>& file) {
  if (changed_ != file) restore();
  file->begin();
  changed_ = file;
}

void TappedFiles::restore() {
  if (const auto changed = std::exchange(changed_, nullptr)) changed->restore();
}

void TappedFiles::let_go() {
  restore();
  kept_.reset();
  timer_.cancel();
}

void TappedFiles::drop(std::shared_ptr<TappedFile> file) {
  if (changed_ == file && kept_ != file) restore();
  if (!file || file.use_count() > 1) return;
  (void)loop_->run_elsewhere(
      closes_, [last = std::move(file)]() mutable { last.reset(); }, [] {});
}

void TappedFiles::look() {
  if (std::exchange(used_, false)) return timer_.set_after(kUnused);
  restore();
  drop(std::move(kept_));
}

}  // namespace porttape
