#include "libport/net/stream_listener.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <fmt/format.h>
#include <fstream>
#include <iterator>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/peer_process.hpp"
#include "libport/net/socket_address.hpp"
#include "libport/net/stream_line.hpp"

namespace porttape {
namespace {

constexpr Nanos kAcceptRetry = std::chrono::milliseconds(100);
// Lines about refused connections are at least so far apart.
constexpr Nanos kTellEvery = std::chrono::seconds(1);

// The address of a connection's other end, or the process there.
std::string peer_of(int fd, const SocketAddress& address) {
  if (address.family() != AF_UNIX) return address.text();
  const std::optional<ucred> process = peer_process(fd);
  if (!process) return "a process";
  std::string name;
  std::ifstream comm(fmt::format("/proc/{}/comm", process->pid));
  std::getline(comm, name);
  return name.empty() ? fmt::format("process {}", process->pid)
                      : fmt::format("{} (pid {})", name, process->pid);
}

std::size_t unread(int fd) {
  int bytes = 0;
  return ::ioctl(fd, FIONREAD, &bytes) == 0 ? static_cast<std::size_t>(bytes) : 0;
}

std::string bytes_lost(int fd) {
  const std::size_t bytes = unread(fd);
  return bytes == 0 ? std::string() : fmt::format("; the {} bytes that it wrote reach nobody", bytes);
}

}  // namespace

void reset_connection(UniqueFd fd) {
  const linger at_once{1, 0};
  (void)::setsockopt(fd.get(), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
}

StreamListener::StreamListener(const PortContext& context, Owner& owner, std::string name, UniqueFd fd)
    : context_(context),
      owner_(&owner),
      name_(std::move(name)),
      fd_(std::move(fd)),
      watch_(*context.loop, fd_.get(), [this] { on_acceptable(); }),
      look_timer_(*context.loop, [this] { look(); }),
      accept_timer_(*context.loop, [this] { watch(); }),
      tell_timer_(*context.loop, [this] { tell_refused(); }) {}

void StreamListener::watch() { watch_.watch_readable(accepts_ && !(context_.pulled && taken_)); }

void StreamListener::accept(bool on) {
  accepts_ = on;
  watch();
  if (on) return;
  taken_ = false;
  accept_timer_.cancel();
  while (!waiting_.empty()) {
    refuse(waiting_.front(), "the port was closed while it waited");
    waiting_.pop_front();
  }
}

void StreamListener::on_acceptable() {
  SocketAddress address;
  address.size = sizeof address.storage;
  UniqueFd fd(::accept4(fd_.get(), reinterpret_cast<sockaddr*>(&address.storage), &address.size,
                        SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (!fd) return not_accepted(errno);
  told_error_ = 0;
  std::string who = peer_of(fd.get(), address);
  newcomer({std::move(fd), std::move(who), context_.loop->now()});
}

void StreamListener::not_accepted(int error_number) {
  if (error_number == EAGAIN || error_number == EINTR || error_number == ECONNABORTED) return;
  if (std::exchange(told_error_, error_number) != error_number) {
    context_.log->error("{}: a connection cannot be accepted: {}{}; it waits, and is tried again", name_,
                        errno_text(error_number),
                        error_number == EMFILE ? " (the limit of this process; see ulimit -n)" : "");
  }
  watch_.watch_readable(false);
  accept_timer_.set_after(kAcceptRetry);
}

void StreamListener::newcomer(Newcomer newcomer) {
  const Inside inside = owner_->inside();
  if (inside == Inside::nobody && waiting_.empty()) return let_in(std::move(newcomer));
  if (waiting_.size() >= kMostWaiting) return refuse(newcomer, "too many wait already");
  waiting_.push_back(std::move(newcomer));
  if (!look_timer_.due()) look_timer_.set_after(kSettling);
}

void StreamListener::let_in(Newcomer newcomer) {
  inside_ = newcomer.who;
  taken_ = true;
  watch();
  owner_->let_in(std::move(newcomer.fd), inside_);
}

void StreamListener::left() {
  taken_ = false;
  watch();
  if (accepts_) drop_all_gone();
  if (waiting_.empty()) return;
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) let_next_in();
  });
}

void StreamListener::drop_all_gone() {
  for (std::deque<Newcomer> waiting = std::exchange(waiting_, {}); !waiting.empty(); waiting.pop_front()) {
    if (is_gone(waiting.front().fd.get())) {
      drop_gone(waiting.front());
    } else {
      waiting_.push_back(std::move(waiting.front()));
    }
  }
}

void StreamListener::let_next_in() {
  while (accepts_ && !waiting_.empty() && owner_->inside() == Inside::nobody) {
    Newcomer next = std::move(waiting_.front());
    waiting_.pop_front();
    if (is_gone(next.fd.get())) {
      drop_gone(next);
    } else {
      let_in(std::move(next));
    }
  }
}

// Each newcomer by the one before it, the first by the one inside. Whoever is told of one may end the line,
// or close the port, from within: nobody waits here meanwhile.
void StreamListener::look() {
  const Instant now = context_.loop->now();
  bool there = owner_->inside() == Inside::there;
  std::string before = inside_;
  std::optional<Instant> next;
  std::deque<Newcomer> waiting = std::exchange(waiting_, {});
  for (auto each = waiting.begin(); each != waiting.end();) {
    const Instant settled = each->since + kSettling;
    if (is_gone(each->fd.get())) {
      drop_gone(*each);
      each = waiting.erase(each);
    } else if (there && now >= settled) {
      refuse(*each, fmt::format("{} is connected already (see --connections)", before));
      each = waiting.erase(each);
    } else {
      if (now < settled) next = next ? std::min(*next, settled) : settled;
      if (!there && now >= settled && !std::exchange(each->told, true))
        context_.log->info("{}: {} waits until the line of {} is down", name_, each->who, before);
      there = !has_ended(each->fd.get());
      before = each->who;
      ++each;
    }
  }
  std::ranges::move(waiting_, std::back_inserter(waiting));
  waiting_ = std::move(waiting);
  if (next) look_timer_.set(*next);
  if (!accepts_) accept(false);
}

bool StreamListener::next_waits() {
  pollfd backlog{fd_.get(), POLLIN, 0};
  if (context_.pulled && ::poll(&backlog, 1, 0) > 0) return true;
  return std::ranges::any_of(waiting_, [this](const Newcomer& each) { return !is_gone(each.fd.get()); });
}

bool StreamListener::is_gone(int fd) {
  pollfd both{fd, 0, 0};
  if (::poll(&both, 1, 0) > 0) return true;
  return has_ended(fd) && owner_->look_at_peer(fd) == PeerState::gone;
}

void StreamListener::drop_gone(Newcomer& newcomer) {
  context_.log->warn("{}: {} went away while it waited{}", name_, newcomer.who,
                     bytes_lost(newcomer.fd.get()));
  owner_->refused(unread(newcomer.fd.get()));
  newcomer.fd.reset();
}

void StreamListener::refuse(Newcomer& newcomer, const std::string& why) {
  const std::string lost = bytes_lost(newcomer.fd.get());
  owner_->refused(unread(newcomer.fd.get()));
  reset_connection(std::move(newcomer.fd));
  if (tell_timer_.due()) {
    ++not_told_;
    return;
  }
  context_.log->warn("{}: {} is refused: {}{}", name_, newcomer.who, why, lost);
  tell_timer_.set_after(kTellEvery);
}

void StreamListener::tell_refused() {
  if (const std::uint64_t count = std::exchange(not_told_, 0); count > 0)
    context_.log->warn("{}: {} more connections were refused", name_, count);
}

}  // namespace porttape
