#include "libport/supervise/own_supervisors.hpp"

#include <cerrno>
#include <fmt/format.h>
#include <linux/seccomp.h>
#include <sys/syscall.h>
#include <utility>

namespace porttape {

std::vector<CallTrap> OwnSupervisors::traps() const { return {{.number = SYS_seccomp}}; }

CallPart::Decision OwnSupervisors::decide(Supervisor&, const Call& call) {
  const bool wants_one = call.number() == SYS_seccomp && call.argument(0) == SECCOMP_SET_MODE_FILTER &&
                         (call.argument(1) & SECCOMP_FILTER_FLAG_NEW_LISTENER) != 0;
  if (!wants_one) return NotMine{};
  if (!std::exchange(told_, true)) {
    tell_(
        fmt::format("process {} wants to supervise calls itself (seccomp notification) and cannot: it gets "
                    "EBUSY here; run it without exec",
                    call.thread()));
  }
  return outcome::Refuse{EBUSY};
}

}  // namespace porttape
