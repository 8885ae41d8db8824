#include "libport/supervise/call_filter.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <fmt/format.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>

#ifndef SECCOMP_FILTER_FLAG_WAIT_KILLABLE_RECV  // Linux 5.19
#define SECCOMP_FILTER_FLAG_WAIT_KILLABLE_RECV (1UL << 5)
#endif

namespace porttape {
namespace {

using Program = std::vector<sock_filter>;

constexpr std::uint32_t kNumberAt = offsetof(seccomp_data, nr);
constexpr std::uint32_t kArchAt = offsetof(seccomp_data, arch);
// The low half of an argument.
constexpr std::uint32_t argument_at(std::size_t index) {
  return static_cast<std::uint32_t>(offsetof(seccomp_data, args) + index * sizeof(std::uint64_t));
}
constexpr std::uint32_t kFileAt = argument_at(0);
constexpr std::uint32_t kRequestAt = argument_at(1);

#if defined(__x86_64__)
constexpr std::uint32_t kNativeArch = AUDIT_ARCH_X86_64;
constexpr std::uint32_t kSmallArch = AUDIT_ARCH_I386;
struct SmallCall {
  int native;
  int small;
};
constexpr std::array kSmallCalls{SmallCall{SYS_ioctl, 54},   SmallCall{SYS_open, 5},
                                 SmallCall{SYS_read, 3},     SmallCall{SYS_write, 4},
                                 SmallCall{SYS_openat, 295}, SmallCall{SYS_tkill, 238},
                                 SmallCall{SYS_tgkill, 270}, SmallCall{SYS_rt_tgsigqueueinfo, 335}};
#elif defined(__aarch64__)
constexpr std::uint32_t kNativeArch = AUDIT_ARCH_AARCH64;
#elif defined(__riscv) && __riscv_xlen == 64
constexpr std::uint32_t kNativeArch = AUDIT_ARCH_RISCV64;
#else
constexpr std::uint32_t kNativeArch = 0;  // not known here: nothing is trapped
#endif

sock_filter load(std::uint32_t at) { return BPF_STMT(BPF_LD | BPF_W | BPF_ABS, at); }
sock_filter answer(std::uint32_t what) { return BPF_STMT(BPF_RET | BPF_K, what); }

// Goes on `skip` instructions further where the value is not this one.
sock_filter unless_equal(std::uint32_t value, std::size_t skip) {
  return BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, static_cast<std::uint8_t>(skip));
}

// For so few a chain is as good as a tree.
void add_search(Program& program, const std::vector<std::uint32_t>& values) {
  for (const std::uint32_t value : values) {
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1));
    program.push_back(answer(SECCOMP_RET_USER_NOTIF));
  }
  program.push_back(answer(SECCOMP_RET_ALLOW));
}

// The kernel looks at the low half of a request alone. The tty requests lie close together: what is outside
// of them is told apart by two comparisons.
Program requests_program(std::vector<std::uint32_t> requests) {
  std::ranges::sort(requests);
  Program program{load(kRequestAt)};
  std::vector<std::uint32_t> far;
  std::vector<std::uint32_t> near;
  for (const std::uint32_t request : requests) (request < 0x10000U ? near : far).push_back(request);
  if (!near.empty() && !far.empty()) {
    Program of_near;
    add_search(of_near, near);
    Program of_far;
    add_search(of_far, far);
    // Plain small numbers first; the encoded ones (direction, size) behind.
    program.push_back(
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, 0x10000U, static_cast<std::uint8_t>(of_near.size()), 0));
    program.insert(program.end(), of_near.begin(), of_near.end());
    program.insert(program.end(), of_far.begin(), of_far.end());
  } else {
    add_search(program, requests);
  }
  return program;
}

Program files_program(std::uint32_t from, bool or_second) {
  constexpr std::uint32_t kFirstAfterStandard = 3;
  const auto seen = [&](std::uint32_t at) {
    return Program{load(at), BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, from, 1, 0),
                   BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kFirstAfterStandard, 1, 0),
                   answer(SECCOMP_RET_USER_NOTIF)};
  };
  Program program = seen(kFileAt);
  if (or_second) {
    const Program second = seen(kRequestAt);
    program.insert(program.end(), second.begin(), second.end());
  }
  program.push_back(answer(SECCOMP_RET_ALLOW));
  return program;
}

Program body_of(const CallTrap& trap) {
  if (trap.files_from) return files_program(*trap.files_from, trap.or_second);
  return trap.requests.empty() ? Program{answer(SECCOMP_RET_USER_NOTIF)} : requests_program(trap.requests);
}

Program flags_program(const CallTrap::Flags& unless) {
  Program program;
  for (const std::uint32_t mask : unless.masks) {
    program.insert(program.end(),
                   {load(argument_at(unless.argument)), BPF_STMT(BPF_ALU | BPF_AND | BPF_K, mask),
                    unless_equal(mask, 1), answer(SECCOMP_RET_ALLOW)});
  }
  return program;
}

Program call_program(const CallTrap& trap, int number) {
  Program body = flags_program(trap.unless);
  const Program of_call = body_of(trap);
  body.insert(body.end(), of_call.begin(), of_call.end());
  Program program{unless_equal(static_cast<std::uint32_t>(number), body.size())};
  program.insert(program.end(), body.begin(), body.end());
  return program;
}

Program arch_program(std::uint32_t arch, const Program& calls) {
  // A conditional jump reaches 255 instructions.
  const auto past = static_cast<std::uint32_t>(calls.size() + 2);
  Program program{load(kArchAt), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, arch, 1, 0),
                  BPF_JUMP(BPF_JMP | BPF_JA, past, 0, 0), load(kNumberAt)};
  program.insert(program.end(), calls.begin(), calls.end());
  program.push_back(answer(SECCOMP_RET_ALLOW));
  return program;
}

Program whole_program(const std::vector<CallTrap>& traps) {
  Program native;
  for (const CallTrap& trap : traps) {
    const Program one = call_program(trap, trap.number);
    native.insert(native.end(), one.begin(), one.end());
  }
  Program program = arch_program(kNativeArch, native);
#if defined(__x86_64__)
  Program small;
  for (const CallTrap& trap : traps) {
    const auto* const known = std::ranges::find(kSmallCalls, trap.number, &SmallCall::native);
    if (known == kSmallCalls.end()) continue;
    const Program one = call_program(trap, known->small);
    small.insert(small.end(), one.begin(), one.end());
  }
  const Program of_small = arch_program(kSmallArch, small);
  program.insert(program.end(), of_small.begin(), of_small.end());
#endif
  program.push_back(answer(SECCOMP_RET_ALLOW));
  return program;
}

int install(const sock_fprog* program, unsigned long flags) {
  return static_cast<int>(::syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, flags, program));
}

Error refused(int error) {
  if (error == EBUSY)
    return make_error(
        Errc::usage,
        "the system calls of what runs here are supervised already (by another porttape exec, or by "
        "a container's manager): start it outside of that");
  if (error == ENOSYS || error == EINVAL)
    return make_error(Errc::usage,
                      fmt::format("this kernel has no seccomp notification ({}): Linux 5.6 or newer has it",
                                  errno_text(error)));
  return make_error(Errc::usage,
                    fmt::format("seccomp is refused here ({}): a container needs it allowed, as by docker's "
                                "--security-opt seccomp=unconfined",
                                errno_text(error)));
}

}  // namespace

// A kernel that knows the flag looks for the program, and does not find it.
bool calls_outlast_signals() {
  return install(nullptr, SECCOMP_FILTER_FLAG_NEW_LISTENER | SECCOMP_FILTER_FLAG_WAIT_KILLABLE_RECV) < 0 &&
         errno == EFAULT;
}

Result<UniqueFd> trap_calls(const std::vector<CallTrap>& traps) {
  if (kNativeArch == 0)
    return make_error(Errc::usage, "system calls are not supervised on this kind of processor");
  Program instructions = whole_program(traps);
  const sock_fprog program{.len = static_cast<unsigned short>(instructions.size()),
                           .filter = instructions.data()};
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0)
    return make_error(Errc::usage, "no_new_privs is refused here: " + errno_text(errno));
  const bool last = calls_outlast_signals();
  // A signal would end a read that is being answered, and what was read from the device would be lost.
  const bool reads =
      std::ranges::any_of(traps, [](const CallTrap& trap) { return trap.files_from.has_value(); });
  if (!last && errno == EINVAL && reads)
    return make_error(Errc::usage,
                      "this kernel lets signals break off what is answered; Linux 5.19 or newer "
                      "does not");
  const int fd = install(
      &program, SECCOMP_FILTER_FLAG_NEW_LISTENER | (last ? SECCOMP_FILTER_FLAG_WAIT_KILLABLE_RECV : 0UL));
  if (fd < 0) return refused(errno);
  return UniqueFd(fd);
}

bool is_32_bit([[maybe_unused]] std::uint32_t arch) {
#if defined(__x86_64__)
  return arch == kSmallArch;
#else
  return false;
#endif
}

int native_call_number([[maybe_unused]] std::uint32_t arch, int number) {
#if defined(__x86_64__)
  if (!is_32_bit(arch)) return number;
  const auto* const known = std::ranges::find(kSmallCalls, number, &SmallCall::small);
  return known == kSmallCalls.end() ? -1 : known->native;
#else
  return number;
#endif
}

}  // namespace porttape
