// Which calls of a thread wait for its supervisor, seen from both ends: the supervisor answers with a value
// that no kernel gives.

#include "libport/supervise/call_filter.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <functional>
#include <future>
#include <linux/audit.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <string>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

using test::holds_without;
using test::RefusedCall;
using testing::HasSubstr;

constexpr long kTold = 4711;
constexpr std::uint32_t kFilesFrom = 960;
constexpr int kNoFile = 900;  // below kFilesFrom, and not open here

struct Made {
  long number;
  long first = 0;
  long second = 0;
  long third = 0;
};

bool is_told(const Made& call) {
  return ::syscall(static_cast<int>(call.number), call.first, call.second, call.third) == kTold;
}

// Runs `work` in a thread whose calls are trapped, and answers them.
void under_supervisor(const std::vector<CallTrap>& traps, const std::function<void()>& work) {
  std::promise<Result<UniqueFd>> trapped;
  const UniqueFd over(::eventfd(0, EFD_CLOEXEC));
  std::thread program([&] {
    Result<UniqueFd> listener = trap_calls(traps);
    const bool goes_on = listener.has_value();
    trapped.set_value(std::move(listener));
    if (goes_on) work();
    ::eventfd_write(over.get(), 1);
  });
  const Result<UniqueFd> listener = trapped.get_future().get();
  EXPECT_TRUE(listener) << listener.error().message;
  std::array<pollfd, 2> polled{pollfd{.fd = listener ? listener->get() : -1, .events = POLLIN, .revents = 0},
                               pollfd{.fd = over.get(), .events = POLLIN, .revents = 0}};
  while (::poll(polled.data(), polled.size(), -1) > 0 && polled.back().revents == 0) {
    seccomp_notif told{};
    if (::ioctl(polled.front().fd, SECCOMP_IOCTL_NOTIF_RECV, &told) != 0) continue;
    seccomp_notif_resp answer{.id = told.id, .val = kTold, .error = 0, .flags = 0};
    EXPECT_EQ(::ioctl(polled.front().fd, SECCOMP_IOCTL_NOTIF_SEND, &answer), 0) << errno;
  }
  program.join();
}

std::vector<bool> told_of(const std::vector<CallTrap>& traps, const std::vector<Made>& calls) {
  std::vector<bool> told;
  under_supervisor(traps, [&] {
    for (const Made& call : calls) told.push_back(is_told(call));
  });
  return told;
}

using Told = std::vector<bool>;

TEST(CallFilter, TheCallsThatAreNamedWaitAndNoOthers) {
  EXPECT_EQ(told_of({{.number = SYS_getsid}, {.number = SYS_getpriority}},
                    {{SYS_getsid}, {SYS_getpgid}, {SYS_getpriority}, {SYS_getppid}}),
            (Told{true, false, true, false}));
}

// The requests of ttys are plain small numbers, and encoded ones with a size, which are far above.
TEST(CallFilter, OfIoctlTheRequestsThatAreNamedWait) {
  const auto asked = [](long request) { return Made{SYS_ioctl, -1, request}; };
  const std::vector<Made> calls{asked(0x5415),     asked(0x5413),     asked(0x5414),     asked(0xffff),
                                asked(0x802c542a), asked(0x10000),    asked(0x802c542b), asked(0x542a),
                                asked(0x402c542a), asked(0x402c5415), asked(0)};
  const std::vector<std::uint32_t> near{0x5415, 0x5413, 0xffff};
  const std::vector<std::uint32_t> far{0x802c542a, 0x10000};
  const auto told = [&](std::vector<std::uint32_t> requests) {
    return told_of({{.number = SYS_ioctl, .requests = std::move(requests)}}, calls);
  };
  EXPECT_EQ(told(near), (Told{true, true, false, true, false, false, false, false, false, false, false}));
  EXPECT_EQ(told(far), (Told{false, false, false, false, true, true, false, false, false, false, false}));
  std::vector<std::uint32_t> both = far;
  both.insert(both.end(), near.begin(), near.end());
  EXPECT_EQ(told(both), (Told{true, true, false, true, true, true, false, false, false, false, false}));
}

TEST(CallFilter, WhatIsBehindACallWithRequestsIsFound) {
  EXPECT_EQ(told_of({{.number = SYS_ioctl, .requests = {0x5415, 0x802c542a}}, {.number = SYS_getsid}},
                    {{SYS_getsid}, {SYS_ioctl, -1, 0x5415}, {SYS_getpgid}}),
            (Told{true, true, false}));
}

TEST(CallFilter, OfHighFilesAndTheStandardOnesCallsWait) {
  const auto read = [](long fd) { return Made{SYS_read, fd}; };
  EXPECT_EQ(told_of({{.number = SYS_read, .files_from = kFilesFrom}}, {read(0),
                                                                       read(2),
                                                                       read(3),
                                                                       read(kFilesFrom - 1),
                                                                       read(kFilesFrom),
                                                                       read(kFilesFrom + 1),
                                                                       {SYS_getsid}}),
            (Told{true, true, false, false, true, true, false}));
}

TEST(CallFilter, TheSecondFileCountsWhereItIsAskedFor) {
  const std::vector<Made> calls{{SYS_dup3, kNoFile, kNoFile},    {SYS_dup3, kNoFile, 2},
                                {SYS_dup3, kNoFile, 3},          {SYS_dup3, kNoFile, kFilesFrom},
                                {SYS_dup3, kFilesFrom, kNoFile}, {SYS_dup3, kNoFile, kFilesFrom - 1}};
  EXPECT_EQ(told_of({{.number = SYS_dup3, .files_from = kFilesFrom, .or_second = true}}, calls),
            (Told{false, true, false, true, true, false}));
  EXPECT_EQ(told_of({{.number = SYS_dup3, .files_from = kFilesFrom}}, calls),
            (Told{false, false, false, false, true, false}));
}

TEST(CallFilter, ACallWithAllFlagsOfAMaskDoesNotWait) {
  const auto open = [](long flags) { return Made{SYS_openat, -1, reinterpret_cast<long>(""), flags}; };
  const CallTrap trap{.number = SYS_openat, .unless = {2, {O_PATH, O_CREAT | O_EXCL}}};
  EXPECT_EQ(told_of({trap, {.number = SYS_getsid}}, {open(O_RDWR),
                                                     open(O_PATH),
                                                     open(O_PATH | O_CLOEXEC),
                                                     open(O_CREAT),
                                                     open(O_EXCL),
                                                     open(O_CREAT | O_EXCL),
                                                     open(O_CREAT | O_EXCL | O_WRONLY),
                                                     {SYS_getsid}}),
            (Told{true, false, false, true, true, false, false, true}));
}

#if defined(__x86_64__)
long small_call(long number, long first, long second) {
  long result = number;
  asm volatile("int $0x80"  // NOLINT(hicpp-no-assembler): there is no other way to make a call of 32 bits
               : "+a"(result)
               : "b"(first), "c"(second), "d"(0L)
               : "memory", "r8", "r9", "r10", "r11");
  return static_cast<int>(result);
}

bool has_small_calls() {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(small_call(20, 0, 0) == ::getpid() ? 0 : 1);  // getpid
  int status = 0;
  return ::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST(CallFilter, CallsOf32BitsWaitByTheirOwnNumbers) {
  if (!has_small_calls()) GTEST_SKIP() << "this kernel runs no programs of 32 bits";
  Told told;
  under_supervisor({{.number = SYS_getsid},  // has no number of 32 bits here
                    {.number = SYS_ioctl, .requests = {0x5415}},
                    {.number = SYS_tgkill}},
                   [&] {
                     for (const auto& [number, second] :
                          {std::pair(54L, 0x5415L), {54L, 0x5416L}, {270L, 0L}, {16L, 0x5415L}, {147L, 0L}})
                       told.push_back(small_call(number, -1, second) == kTold);
                     told.push_back(is_told({SYS_ioctl, -1, 0x5415}));
                     told.push_back(is_told({54, -1, 0x5415}));
                   });
  EXPECT_EQ(told, (Told{true, false, true, false, false, true, false}));
}

TEST(CallFilter, NumbersOf32BitsAreThoseOfTheSameCalls) {
  EXPECT_TRUE(is_32_bit(AUDIT_ARCH_I386));
  EXPECT_FALSE(is_32_bit(AUDIT_ARCH_X86_64));
  const auto native = [](int number) { return native_call_number(AUDIT_ARCH_I386, number); };
  EXPECT_EQ(native(54), SYS_ioctl);
  EXPECT_EQ(native(5), SYS_open);
  EXPECT_EQ(native(295), SYS_openat);
  EXPECT_EQ(native(238), SYS_tkill);
  EXPECT_EQ(native(270), SYS_tgkill);
  EXPECT_EQ(native(335), SYS_rt_tgsigqueueinfo);
  EXPECT_EQ(native(3), SYS_read);
  EXPECT_EQ(native(20), -1) << "getpid, which is not supervised";
  EXPECT_EQ(native_call_number(AUDIT_ARCH_X86_64, 54), 54);
}
#endif

std::string trouble_of(const std::vector<CallTrap>& traps) {
  const Result<UniqueFd> made = trap_calls(traps);
  if (made) return "none";
  EXPECT_EQ(made.error().code, Errc::usage);
  return made.error().message;
}

const std::vector<CallTrap> kAny{{.number = SYS_getsid}};
const std::vector<CallTrap> kReads{{.number = SYS_getsid}, {.number = SYS_read, .files_from = kFilesFrom}};

TEST(CallFilter, WhatForbidsItIsNamed) {
  const auto without = [](const std::vector<RefusedCall>& calls, const std::vector<CallTrap>& traps,
                          const std::string& expected) {
    EXPECT_TRUE(holds_without(calls, [&] { EXPECT_EQ(trouble_of(traps), expected); })) << expected;
  };
  without({{SYS_seccomp, ENOSYS}}, kAny,
          "this kernel has no seccomp notification (Function not implemented): Linux 5.6 or newer has it");
  without({{SYS_seccomp, EINVAL}}, kAny,
          "this kernel has no seccomp notification (Invalid argument): Linux 5.6 or newer has it");
  without({{SYS_seccomp, EPERM}}, kAny,
          "seccomp is refused here (Operation not permitted): a container needs it allowed, as by docker's "
          "--security-opt seccomp=unconfined");
  without({{SYS_prctl, EPERM, RefusedCall::Argument{0, 0xffffffff, PR_SET_NO_NEW_PRIVS}}}, kAny,
          "no_new_privs is refused here: Operation not permitted");
  EXPECT_TRUE(holds_without({}, [] {
    const Result<UniqueFd> first = trap_calls(kAny);
    ASSERT_TRUE(first) << first.error().message;
    EXPECT_THAT(trouble_of({{.number = SYS_getpgid}}), HasSubstr("supervised already"));
  }));
}

// A signal would end a read that is being answered, and what it took from the device would be lost.
TEST(CallFilter, WhereSignalsEndWhatIsAnsweredNoReadsAreTaken) {
  constexpr std::uint32_t kOutlast = 1U << 5U;  // SECCOMP_FILTER_FLAG_WAIT_KILLABLE_RECV
  const RefusedCall old{SYS_seccomp, EINVAL, RefusedCall::Argument{1, kOutlast, kOutlast}};
  EXPECT_TRUE(holds_without({old}, [] {
    EXPECT_FALSE(calls_outlast_signals());
    EXPECT_EQ(errno, EINVAL);
    EXPECT_EQ(trouble_of(kReads),
              "this kernel lets signals break off what is answered; Linux 5.19 or newer does not");
  }));
  EXPECT_TRUE(holds_without({old}, [] { EXPECT_EQ(trouble_of(kAny), "none"); }));
}

TEST(CallFilter, WhatATrappedProcessStartsIsTrappedToo) {
  EXPECT_TRUE(holds_without({}, [] {
    EXPECT_EQ(trouble_of(kAny), "none");  // and its supervisor has gone
    EXPECT_EQ(::getsid(0), -1);
    EXPECT_EQ(errno, ENOSYS);
    const pid_t child = ::fork();
    if (child == 0) ::_exit(::getsid(0) == -1 && errno == ENOSYS ? 0 : 1);
    int status = -1;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(status, 0);
  }));
}

}  // namespace
}  // namespace porttape
