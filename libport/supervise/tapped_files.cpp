#include "libport/supervise/tapped_files.hpp"

#include <cerrno>
#include <fcntl.h>
#include <optional>
#include <utility>

namespace porttape {
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

std::shared_ptr<TappedFile> TappedFiles::find(const Call& call, const TtyDevice& device, int& error) {
  const auto fd = static_cast<int>(call.argument(0));
  std::shared_ptr<TappedFile> file = last_.lock();
  if (!file || file->users_ == 0 || !call.has_as(fd, file->fd())) {
    UniqueFd duplicate = call.duplicate(fd);
    if (!duplicate) {
      error = errno;
      return nullptr;
    }
    const std::optional<TtyDevice> found = tty_device_of(duplicate.get());
    if (!found || !found->is(device)) return nullptr;
    file = {new TappedFile(std::move(duplicate)), [this](TappedFile* unused) {
              const std::unique_ptr<TappedFile> last(unused);
              last->watch_ = {};
              if (last->fd_) close_elsewhere(std::move(last->fd_));
            }};
    last_ = file;
  }
  ++file->users_;
  return file;
}

void TappedFiles::let_go(const Call& call, TappedFile& file) {
  if (--file.users_ > 0) return;
  file.watch_ = {};
  if (call.has_as(static_cast<int>(call.argument(0)), file.fd())) return file.fd_.reset();
  close_elsewhere(std::move(file.fd_));
}

void TappedFiles::close_elsewhere(UniqueFd file) {
  (void)loop_->run_elsewhere(
      closes_, [last = std::make_shared<UniqueFd>(std::move(file))] { last->reset(); }, [] {});
}

}  // namespace porttape
