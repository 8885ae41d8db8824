#include "libport/supervise/supervisor.hpp"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>

#include "libport/supervise/pending_signals.hpp"

// Linux 5.14 and 6.6.
#ifndef SECCOMP_ADDFD_FLAG_SEND
#define SECCOMP_ADDFD_FLAG_SEND (1UL << 1)
#endif
#ifndef SECCOMP_IOCTL_NOTIF_SET_FLAGS
#define SECCOMP_IOCTL_NOTIF_SET_FLAGS SECCOMP_IOW(4, __u64)
#define SECCOMP_USER_NOTIF_FD_SYNC_WAKE_UP (1UL << 0)
#endif

namespace porttape {
namespace {

// A newer kernel's structs may be larger than ours.
seccomp_notif_sizes sizes_here() {
  seccomp_notif_sizes sizes{};
  if (::syscall(SYS_seccomp, SECCOMP_GET_NOTIF_SIZES, 0, &sizes) != 0) sizes = {};
  sizes.seccomp_notif = std::max<__u16>(sizes.seccomp_notif, sizeof(seccomp_notif));
  sizes.seccomp_notif_resp = std::max<__u16>(sizes.seccomp_notif_resp, sizeof(seccomp_notif_resp));
  return sizes;
}

}  // namespace

void KeptCall::finish(Outcome outcome) {
  if (const auto finish = std::exchange(finish_, {})) finish(std::move(outcome));
}

void KeptCall::call_at(Instant when, std::function<void()> callback) {
  at_ = when;
  at_callback_ = std::move(callback);
  if (reschedule_) reschedule_();
}

Supervisor::Supervisor(Loop& loop, UniqueFd listener, std::vector<std::unique_ptr<CallPart>> parts)
    : listener_(std::move(listener)),
      parts_(std::move(parts)),
      loop_(&loop),
      calls_stay_(calls_outlast_signals()),
      told_(sizes_here().seccomp_notif),
      response_(sizes_here().seccomp_notif_resp),
      watch_(loop, listener_.get(), [this] { on_readable(); }),
      call_timer_(loop, [this] { call_back_due(); }),
      look_timer_(
          loop, [this] { look(); }, Timer::By::machine) {
  // Only faster, and only from Linux 6.6 on.
  const std::uint64_t flags = SECCOMP_USER_NOTIF_FD_SYNC_WAKE_UP;
  (void)::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_SET_FLAGS, flags);
  watch_.watch_readable(true);
}

Supervisor::~Supervisor() {
  for (const auto& kept : kept_) kept->finish_ = {};
}

void Supervisor::on_readable() {
  for (int taken = 0; taken < kInARow; ++taken) {
    // One whose thread has gone meanwhile is told no more, and to receive it would wait for the next.
    pollfd polled{.fd = listener_.get(), .events = POLLIN, .revents = 0};
    if (::poll(&polled, 1, 0) != 1) return;
    if ((polled.revents & POLLIN) == 0) return all_gone();
    take_one();
  }
}

// The programs, and so what was kept of them.
void Supervisor::all_gone() {
  watch_.watch_readable(false);
  forget_gone();
  kept_.clear();
  schedule();
}

void Supervisor::take_one() {
  std::ranges::fill(told_, std::byte{0});
  auto* const told = reinterpret_cast<seccomp_notif*>(told_.data());
  if (::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_RECV, told) == 0)
    handle(Call(listener_.get(), threads_, *told, calls_stay_));
}

void Supervisor::handle(const Call& call) {
  for (const auto& part : parts_) {
    CallPart::Decision decision = part->decide(*this, call);
    if (std::holds_alternative<CallPart::NotMine>(decision)) continue;
    if (Outcome* const outcome = std::get_if<Outcome>(&decision)) send(call, std::move(*outcome));
    return;
  }
  send(call, outcome::Pass{});
}

// Nullopt: the call has been answered, or has ended. Giving the file and answering in one (SEND) is for where
// a signal to the thread may end its call between the two. Where none does it is done in two: a signal to the
// supervisor, a stop among them, would end the one before the file is given, and the call with descriptor 0.
std::optional<Outcome> Supervisor::install_file(std::uint64_t id, const outcome::Install& install) {
  seccomp_notif_addfd add{};
  add.id = id;
  add.srcfd = static_cast<__u32>(install.file.get());
  add.newfd = static_cast<__u32>(install.at.value_or(0));
  add.flags = (calls_stay_ ? 0U : SECCOMP_ADDFD_FLAG_SEND) | (install.at ? SECCOMP_ADDFD_FLAG_SETFD : 0U);
  add.newfd_flags = install.close_on_exec ? O_CLOEXEC : 0U;
  int given = -1;
  do {
    given = ::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_ADDFD, &add);
  } while (given < 0 && errno == EINTR);
  if (given < 0) return errno == ENOENT ? std::nullopt : std::optional<Outcome>(outcome::Refuse{errno});
  return calls_stay_ ? std::optional<Outcome>(outcome::Answer{given}) : std::nullopt;
}

void Supervisor::send(const Call& call, Outcome outcome) {
  if (auto* const install = std::get_if<outcome::Install>(&outcome)) {
    std::optional<Outcome> given = install_file(call.id(), *install);
    if (!given) return;
    outcome = std::move(*given);
  }
  std::ranges::fill(response_, std::byte{0});
  auto* const response = reinterpret_cast<seccomp_notif_resp*>(response_.data());
  response->id = call.id();
  if (const auto* const answer = std::get_if<outcome::Answer>(&outcome)) response->val = answer->value;
  if (const auto* const refuse = std::get_if<outcome::Refuse>(&outcome)) response->error = -refuse->error;
  if (std::holds_alternative<outcome::Pass>(outcome)) response->flags = SECCOMP_USER_NOTIF_FLAG_CONTINUE;
  // ENOENT: a signal has ended the call, or the thread.
  (void)::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_SEND, response);
}

std::shared_ptr<KeptCall> Supervisor::keep(const Call& call) {
  auto kept = std::make_shared<KeptCall>(call, loop_->clock());
  kept->finish_ = [this, call](Outcome outcome) { send(call, std::move(outcome)); };
  kept->reschedule_ = [this] { schedule(); };
  kept_.push_back(kept);
  schedule();
  return kept;
}

std::shared_ptr<KeptCall> Supervisor::keep_until_signal(const Call& call) {
  std::shared_ptr<KeptCall> kept = keep(call);
  kept->on_gone([weak = std::weak_ptr(kept)] {
    if (const auto waiting = weak.lock()) waiting->finish(outcome::Refuse{EINTR});
  });
  return kept;
}

void Supervisor::call_back_due() {
  const Instant now = loop_->now();
  for (const auto& kept : std::list(kept_)) {
    if (kept->over() || !kept->at_ || *kept->at_ > now) continue;
    kept->at_.reset();
    if (const auto callback = std::exchange(kept->at_callback_, {})) callback();
  }
  std::erase_if(kept_, [](const auto& kept) { return kept->over(); });
  schedule();
}

void Supervisor::look() {
  forget_gone();
  look_at_signals();
  std::erase_if(kept_, [](const auto& kept) { return kept->over(); });
  schedule();
}

// The error that a signal makes of the call; 0: none does. A signal for a whole process interrupts one of its
// threads: the kernel takes the first one, unless that blocks it or has ended, else one that is not to be
// known. Only a thread that looks for signals may be told of one: 512 would reach the program else.
int Supervisor::interruption_of(KeptCall& kept, std::set<pid_t>& told) {
  const pid_t thread = kept.call().thread();
  const ThreadStatus status = thread_status(thread);
  if (status.sent_to_thread != 0) return KeptCall::kRestart;
  const bool alone = status.threads <= 1;
  if (status.sent_to_process == 0) {
    kept.seen_before_ = false;
    // It is to stop with the one that has taken the signal for that.
    const bool looks = !alone && ++kept.looks_ % kStopLook == 0;
    return looks && thread_status(status.process).state == 'T' ? KeptCall::kRestart : 0;
  }
  if (alone) return KeptCall::kRestart;
  const ThreadStatus first = thread_status(status.process);
  if (first.takes_signals() && (first.sent_to_process & status.sent_to_process) != 0)
    return status.process == thread ? KeptCall::kRestart : 0;
  // Another that can take it has done so by the next look.
  const bool seen_before = std::exchange(kept.seen_before_, true);
  if (!seen_before || !told.insert(status.process).second) return 0;
  return have_signals_looked_for(thread) ? KeptCall::kRestart : EINTR;
}

void Supervisor::look_at_signals() {
  std::set<pid_t> told;
  for (const auto& kept : std::list(kept_)) {
    const int error = kept->over() ? 0 : interruption_of(*kept, told);
    if (error == 0) continue;
    if (const auto gone = std::exchange(kept->on_gone_, {})) gone();
    kept->finish(outcome::Refuse{error});
  }
}

void Supervisor::forget_gone() {
  for (const auto& kept : std::list(kept_)) {
    if (kept->over() || kept->call().waits()) continue;
    kept->finish_ = {};
    if (const auto gone = std::exchange(kept->on_gone_, {})) gone();
  }
}

void Supervisor::schedule() {
  if (kept_.empty()) look_timer_.cancel();
  if (!kept_.empty() && !look_timer_.due()) look_timer_.set_after(kSignalLook);
  std::optional<Instant> next;
  for (const auto& kept : kept_) {
    if (!kept->over() && kept->at_) next = std::min(next.value_or(*kept->at_), *kept->at_);
  }
  if (next) {
    call_timer_.set(*next);
  } else {
    call_timer_.cancel();
  }
}

}  // namespace porttape
