#include "libport/loop/urgent_events.hpp"

#include <array>
#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <sched.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <system_error>
#include <utility>

namespace porttape {
namespace {

constexpr std::uint64_t kWake = 0;

bool add(int epoll, int fd, std::uint32_t events, std::uint64_t id) {
  epoll_event event{};
  event.events = events;
  event.data.u64 = id;
  return ::epoll_ctl(epoll, EPOLL_CTL_ADD, fd, &event) == 0;
}

}  // namespace

UrgentEvents::~UrgentEvents() { stop(); }

std::unique_ptr<UrgentEvents::Watch> UrgentEvents::watch(int fd, Answer answer) {
  if (!thread_.joinable() && !start()) return nullptr;
  Member member{UniqueFd(::fcntl(fd, F_DUPFD_CLOEXEC, 0)), answer};
  const std::uint64_t id = next_id_++;
  const std::lock_guard lock(mutex_);
  if (!member.fd || !add(epoll_.get(), member.fd.get(), EPOLLPRI | EPOLLET, id)) return nullptr;
  members_[id] = std::move(member);
  return std::make_unique<Watch>(*this, id);
}

bool UrgentEvents::start() {
  epoll_.reset(::epoll_create1(EPOLL_CLOEXEC));
  wake_.reset(::eventfd(0, EFD_CLOEXEC));
  if (!epoll_ || !wake_ || !add(epoll_.get(), wake_.get(), EPOLLIN, kWake)) return false;
  stopping_ = false;
  // Signals are the loop's.
  sigset_t all;
  sigset_t before;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_BLOCK, &all, &before);
  try {
    thread_ = std::thread([this] { run(); });
  } catch (const std::system_error&) {  // none to be had
  }
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
  return thread_.joinable();
}

void UrgentEvents::stop() {
  if (!thread_.joinable()) return;
  stopping_ = true;
  (void)::eventfd_write(wake_.get(), 1);
  thread_.join();
}

void UrgentEvents::run() {
  const sched_param priority{.sched_priority = 1};
  (void)::sched_setscheduler(0, SCHED_FIFO, &priority);
  std::array<epoll_event, 16> events;
  while (!stopping_) {
    const int count = ::epoll_wait(epoll_.get(), events.data(), events.size(), -1);
    if (count < 0 && errno != EINTR) return;
    for (int i = 0; i < count; ++i) answer_for(events.at(static_cast<std::size_t>(i)).data.u64);
  }
}

void UrgentEvents::answer_for(std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  if (const auto member = members_.find(id); member != members_.end())
    member->second.answer(member->second.fd.get());
}

void UrgentEvents::remove(std::uint64_t id) {
  bool last = false;
  {
    const std::lock_guard lock(mutex_);
    if (const auto member = members_.find(id); member != members_.end()) {
      (void)::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, member->second.fd.get(), nullptr);
      members_.erase(member);
    }
    last = members_.empty();
  }
  if (last) stop();
}

}  // namespace porttape
