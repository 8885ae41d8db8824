#pragma once

#include <cstddef>
#include <cstdint>
#include <linux/audit.h>
#include <linux/seccomp.h>
#include <optional>
#include <sys/syscall.h>
#include <unistd.h>

#include "libport/supervise/call.hpp"
#include "libport/supervise/known_threads.hpp"

namespace porttape::test {

inline std::uint64_t address_of(const void* what) { return reinterpret_cast<std::uintptr_t>(what); }

// A call of this thread, as its supervisor would have it; the thread waits in none. The arguments are the
// numbers from 1 on.
class OwnCall {
 public:
  // `known`: its thread has made a call before.
  explicit OwnCall(std::uint32_t arch = AUDIT_ARCH_X86_64, bool known = true) {
    const pid_t self = ::gettid();
    if (known) threads.keep(self, UniqueFd(static_cast<int>(::syscall(SYS_pidfd_open, ::getpid(), 0))));
    seccomp_notif told{};
    told.id = 17;
    told.pid = static_cast<std::uint32_t>(self);
    told.data.arch = arch;
    told.data.nr = SYS_ioctl;
    for (std::size_t i = 0; i < 6; ++i) told.data.args[i] = i + 1;
    call.emplace(-1, threads, told, true);
  }
  // Once the thread has been seen, its memory may be written.
  const Call& seen() const {
    (void)call->duplicate(STDIN_FILENO);
    return *call;
  }

  KnownThreads threads;
  std::optional<Call> call;
};

}  // namespace porttape::test
