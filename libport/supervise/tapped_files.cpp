#include "libport/supervise/tapped_files.hpp"

#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <utility>

namespace porttape {
namespace {

constexpr Nanos kUnused = std::chrono::milliseconds(10);

}  // namespace

bool TappedFile::waits() const {
  const int flags = ::fcntl(fd_.get(), F_GETFL);
  return flags >= 0 && (flags & O_NONBLOCK) == 0;
}

WithoutWaiting::WithoutWaiting(const TappedFile& file)
    : fd_(file.fd()),
      flags_(::fcntl(fd_, F_GETFL)),
      waits_(flags_ >= 0 && (flags_ & O_NONBLOCK) == 0),
      changed_(waits_ && ::fcntl(fd_, F_SETFL, flags_ | O_NONBLOCK) == 0) {}

WithoutWaiting::~WithoutWaiting() {
  if (changed_) ::fcntl(fd_, F_SETFL, flags_);
}

TappedFiles::TappedFiles(Loop& loop) : loop_(&loop), timer_(loop, [this] { look(); }) {}

std::shared_ptr<TappedFile> TappedFiles::find(const Call& call, int fd, const TtyDevice& device, int& error) {
  error = 0;
  used_ = true;
  if (kept_) {
    if (call.has_as(fd, kept_->fd())) return kept_;
    drop(std::move(kept_));
    timer_.cancel();
  }
  UniqueFd file = call.duplicate(fd);
  if (!file) {
    error = errno;
    return nullptr;
  }
  const std::optional<TtyDevice> found = tty_device_of(file.get());
  if (!found || !found->is(device)) return nullptr;
  let_go();
  kept_ = std::make_shared<TappedFile>(std::move(file));
  timer_.set_after(kUnused);
  return kept_;
}

void TappedFiles::let_go() {
  kept_.reset();
  timer_.cancel();
}

void TappedFiles::drop(std::shared_ptr<TappedFile> file) {
  if (!file || file.use_count() > 1) return;
  (void)loop_->run_elsewhere(
      closes_, [last = std::move(file)]() mutable { last.reset(); }, [] {});
}

void TappedFiles::look() {
  if (std::exchange(used_, false)) return timer_.set_after(kUnused);
  drop(std::move(kept_));
}

}  // namespace porttape
