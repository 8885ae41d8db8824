#include "libport/loop/outbox.hpp"

#include <cerrno>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace porttape {

Outbox::Outbox(int fd, Kind kind, FdWatch& watch, std::function<void()> on_drained,
               std::function<void(int, std::size_t)> on_error)
    : fd_(fd),
      kind_(kind),
      watch_(&watch),
      on_drained_(std::move(on_drained)),
      on_error_(std::move(on_error)) {}

void Outbox::write(ByteView data) {
  const std::size_t sent = congested() ? 0 : send(data);
  if (sent == data.size()) return;
  pending_.insert(pending_.end(), data.begin() + static_cast<std::ptrdiff_t>(sent), data.end());
  watch_->watch_writable(true);
}

std::size_t Outbox::write_some(ByteView data) {
  const std::size_t sent = congested() ? 0 : send(data);
  if (sent < data.size()) watch_->watch_writable(true);
  return sent;
}

void Outbox::flush() {
  sent_ += send(ByteView(pending_).subspan(sent_));
  if (congested()) return;
  forget_pending();
  if (!broken_) on_drained_();
}

void Outbox::discard() {
  forget_pending();
  broken_ = false;
}

void Outbox::forget_pending() {
  pending_.clear();
  sent_ = 0;
  watch_->watch_writable(false);
}

std::size_t Outbox::send(ByteView data) {
  std::size_t sent = 0;
  while (sent < data.size()) {
    const ByteView rest = data.subspan(sent);
    const ssize_t n = kind_ == Kind::socket ? ::send(fd_, rest.data(), rest.size(), MSG_NOSIGNAL)
                                            : ::write(fd_, rest.data(), rest.size());
    if (n > 0) {
      sent += static_cast<std::size_t>(n);
    } else if (n == 0 || errno == EAGAIN || errno == ENOMEM || errno == ENOBUFS) {
      break;
    } else if (errno != EINTR) {
      broken_ = true;
      on_error_(errno, data.size() - sent);
      return data.size();  // a broken line takes everything and keeps nothing
    }
  }
  return sent;
}

}  // namespace porttape
