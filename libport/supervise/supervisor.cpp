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

Supervisor::Supervisor(Loop& loop, UniqueFd listener, std::vector<std::unique_ptr<CallPart>> parts)
    : listener_(std::move(listener)),
      parts_(std::move(parts)),
      calls_stay_(calls_outlast_signals()),
      told_(sizes_here().seccomp_notif),
      response_(sizes_here().seccomp_notif_resp),
      kept_(loop, [this](const Call& call, Outcome outcome) { send(call, std::move(outcome)); }),
      watch_(loop, listener_.get(), [this] { on_readable(); }) {
  // Only faster, and only from Linux 6.6 on.
  const std::uint64_t flags = SECCOMP_USER_NOTIF_FD_SYNC_WAKE_UP;
  (void)::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_SET_FLAGS, flags);
  watch_.watch_readable(true);
}

Supervisor::~Supervisor() = default;

std::vector<CallTrap> Supervisor::traps(const std::vector<std::unique_ptr<CallPart>>& parts) {
  std::vector<CallTrap> traps = KeptCalls::traps();
  for (const auto& part : parts) {
    for (CallTrap& trap : part->traps()) traps.push_back(std::move(trap));
  }
  return traps;
}

void Supervisor::on_readable() {
  // Each of these calls goes through all that are kept.
  const int most = kept_.size() > kManyKept ? 1 : kInARow;
  for (int taken = 0; taken < most; ++taken) {
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
  kept_.all_gone();
}

void Supervisor::take_one() {
  std::ranges::fill(told_, std::byte{0});
  auto* const told = reinterpret_cast<seccomp_notif*>(told_.data());
  if (::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_RECV, told) == 0)
    handle(Call(listener_.get(), threads_, *told, calls_stay_));
}

void Supervisor::handle(const Call& call) {
  if (kept_.sends(call)) return send(call, outcome::Pass{});
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
  if (install.given) install.given(given);
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
  while (::ioctl(listener_.get(), SECCOMP_IOCTL_NOTIF_SEND, response) != 0 && errno == EINTR) {
  }
}

std::shared_ptr<KeptCall> Supervisor::keep(const Call& call) { return kept_.add(call); }

std::shared_ptr<KeptCall> Supervisor::keep_until_signal(const Call& call) {
  std::shared_ptr<KeptCall> kept = keep(call);
  kept->on_gone([weak = std::weak_ptr(kept)] {
    if (const auto waiting = weak.lock()) waiting->finish(outcome::Refuse{EINTR});
  });
  return kept;
}

}  // namespace porttape
