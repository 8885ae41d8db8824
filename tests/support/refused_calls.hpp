#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

// Systems that lack something, or fail, without having one at hand.
namespace porttape::test {

// A system call that fails with an errno; where `argument` is given, only if those bits of it are `value`.
struct RefusedCall {
  struct Argument {
    unsigned index = 0;
    std::uint32_t mask = 0;
    std::uint32_t value = 0;
  };
  long number = 0;
  int error = 0;
  std::optional<Argument> argument = {};
};

// One of the requests of ioctl().
inline RefusedCall refused_ioctl(unsigned long request, int error) {
  return {SYS_ioctl, error, RefusedCall::Argument{1, 0xffffffff, static_cast<std::uint32_t>(request)}};
}

// A call whose first argument is this descriptor.
inline RefusedCall refused_on(int fd, long number, int error) {
  return {number, error, RefusedCall::Argument{0, 0xffffffff, static_cast<std::uint32_t>(fd)}};
}

// An open() with all of these flags.
inline RefusedCall refused_open(int flags, int error) {
  const auto mask = static_cast<std::uint32_t>(flags);
  return {SYS_openat, error, RefusedCall::Argument{2, mask, mask}};
}

inline sock_filter filter_step(unsigned code, std::uint32_t value, unsigned char skip_if_not = 0) {
  return {static_cast<unsigned short>(code), 0, skip_if_not, value};
}

// Of this thread from now on, and of those that it starts.
inline bool refuse(const std::vector<RefusedCall>& calls) {
  std::vector<sock_filter> filter;
  for (const RefusedCall& call : calls) {
    filter.push_back(filter_step(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)));
    filter.push_back(filter_step(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call.number),
                                 call.argument ? 4 : 1));
    if (call.argument) {
      const auto at = static_cast<std::uint32_t>(offsetof(seccomp_data, args) + 8 * call.argument->index);
      filter.push_back(filter_step(BPF_LD | BPF_W | BPF_ABS, at));
      filter.push_back(filter_step(BPF_ALU | BPF_AND | BPF_K, call.argument->mask));
      filter.push_back(filter_step(BPF_JMP | BPF_JEQ | BPF_K, call.argument->value, 1));
    }
    filter.push_back(
        filter_step(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | static_cast<std::uint32_t>(call.error)));
  }
  filter.push_back(filter_step(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog program{static_cast<unsigned short>(filter.size()), filter.data()};
  return ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

// Runs `work` in a child process in which these calls are refused. Fails where one of its expectations does,
// which the child prints.
inline testing::AssertionResult holds_without(const std::vector<RefusedCall>& calls,
                                              const std::function<void()>& work) {
  std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    const bool refused = refuse(calls);
    if (refused) work();
    std::fflush(nullptr);
    ::_exit(!refused ? 2 : testing::Test::HasFailure() ? 1 : 0);
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) != child) return testing::AssertionFailure() << "no child";
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return testing::AssertionSuccess();
  return testing::AssertionFailure() << (WIFEXITED(status) && WEXITSTATUS(status) == 2
                                             ? "the system calls cannot be refused"
                                             : "in the child: status " + std::to_string(status));
}

// Runs `work` in a thread of this process in which these calls are refused; the caller's are not, so that a
// test can go on where the system has recovered.
inline testing::AssertionResult while_refused(const std::vector<RefusedCall>& calls,
                                              const std::function<void()>& work) {
  bool refused = false;
  std::thread([&] {
    refused = refuse(calls);
    if (refused) work();
  }).join();
  return refused ? testing::AssertionSuccess()
                 : testing::AssertionFailure() << "the system calls cannot be refused";
}

}  // namespace porttape::test
