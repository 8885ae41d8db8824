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
  const Sent sent = congested() ? Sent{} : send(data);
  if (sent.error != 0) return fail(sent.error, data.size() - sent.bytes);
  if (sent.bytes == data.size()) return;
  pending_.insert(pending_.end(), data.begin() + static_cast<std::ptrdiff_t>(sent.bytes), data.end());
  wait();
}

std::size_t Outbox::write_some(ByteView data) {
  const Sent sent = congested() ? Sent{} : send(data);
  if (sent.error != 0) {
    fail(sent.error, data.size() - sent.bytes);
    return data.size();  // a broken line takes everything and keeps nothing
  }
  if (sent.bytes < data.size()) wait();
  return sent.bytes;
}

void Outbox::put(Event event) {
  if (broken_) {
    (void)event(Turn::never);
  } else if (congested() || !event(Turn::now)) {
    events_.push_back({pending_.size(), std::move(event)});
    wait();
  }
}

void Outbox::flush() {
  while (congested()) {
    const std::size_t end = events_.empty() ? pending_.size() : events_.front().place;
    const Sent sent = send(ByteView(pending_).subspan(sent_, end - sent_));
    sent_ += sent.bytes;
    if (sent.error != 0) return fail(sent.error, pending());
    if (sent_ < end || (!events_.empty() && !call_next_event())) return;
  }
  const bool owed = owes_drained_;  // not after an event that has discarded the rest
  (void)forget_pending();
  if (owed && !broken_) on_drained_();
}

bool Outbox::call_next_event() {
  Event event = std::move(events_.front().event);
  events_.erase(events_.begin());
  if (event(Turn::now)) return true;
  events_.insert(events_.begin(), WaitingEvent{sent_, std::move(event)});
  return false;
}

void Outbox::discard() {
  broken_ = false;
  for (const WaitingEvent& waiting : forget_pending()) (void)waiting.event(Turn::never);
}

void Outbox::wait() {
  owes_drained_ = true;
  watch_->watch_writable(true);
}

std::vector<Outbox::WaitingEvent> Outbox::forget_pending() {
  pending_.clear();
  sent_ = 0;
  owes_drained_ = false;
  watch_->watch_writable(false);
  return std::exchange(events_, {});
}

void Outbox::fail(int error_number, std::size_t lost) {
  broken_ = true;
  const std::vector<WaitingEvent> events = forget_pending();
  on_error_(error_number, lost);
  for (const WaitingEvent& waiting : events) (void)waiting.event(Turn::never);
}

Outbox::Sent Outbox::send(ByteView data) const {
  Sent sent;
  while (sent.bytes < data.size()) {
    const ByteView rest = data.subspan(sent.bytes);
    const ssize_t n = kind_ == Kind::socket ? ::send(fd_, rest.data(), rest.size(), MSG_NOSIGNAL)
                                            : ::write(fd_, rest.data(), rest.size());
    if (n > 0) {
      sent.bytes += static_cast<std::size_t>(n);
    } else if (n == 0 || errno == EAGAIN || errno == ENOMEM || errno == ENOBUFS) {
      break;
    } else if (errno != EINTR) {
      sent.error = errno;
      break;
    }
  }
  return sent;
}

}  // namespace porttape
