// A real program under the supervisor of a loop whose clock the test moves.

#include "libport/supervise/supervisor.hpp"

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <fcntl.h>
#include <functional>
#include <memory>
#include <optional>
#include <pthread.h>
#include <string>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <thread>
#include <time.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/clock.hpp"
#include "libport/supervise/kept_calls.hpp"
#include "libport/supervise/supervised_command.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"

namespace porttape {
namespace {

using std::chrono::hours;
using std::chrono::nanoseconds;
using std::chrono::seconds;

// A program's sleeps, which last by the supervisor's clock.
class Sleeps final : public CallPart {
 public:
  explicit Sleeps(std::vector<Nanos>& asked) : asked_(&asked) {}

  [[nodiscard]] std::vector<CallTrap> traps() const override {
    return {{.number = SYS_nanosleep}, {.number = SYS_clock_nanosleep}};
  }
  Decision decide(Supervisor& supervisor, const Call& call) override {
    const auto time = call.read_as<timespec>(call.argument(call.number() == SYS_nanosleep ? 0 : 2));
    if (!time) return NotMine{};
    const Nanos length = seconds(time->tv_sec) + nanoseconds(time->tv_nsec);
    const std::shared_ptr<KeptCall> kept = supervisor.keep_until_signal(call);
    kept->call_after(length, [weak = std::weak_ptr(kept)] {
      if (const auto waiting = weak.lock()) waiting->finish(outcome::Answer{0});
    });
    kept->on_gone([this, weak = std::weak_ptr(kept)] {
      ++gone_;
      if (const auto waiting = weak.lock()) waiting->finish(outcome::Refuse{EINTR});
    });
    asked_->push_back(length);
    return Kept{};
  }
  [[nodiscard]] const int& gone() const { return gone_; }

 private:
  std::vector<Nanos>* asked_;
  int gone_ = 0;  // calls that a signal or their thread's end came before
};

// Gives a program that opens this path a file, at the lowest descriptor that is free.
constexpr const char* kGiven = "/given-by-the-supervisor";

class GivesFiles final : public CallPart {
 public:
  [[nodiscard]] std::vector<CallTrap> traps() const override { return {{.number = SYS_openat}}; }
  Decision decide(Supervisor&, const Call& call) override {
    if (call.read_path(call.argument(1)) != kGiven) return NotMine{};
    return Outcome(outcome::Install{UniqueFd(::open("/dev/null", O_RDONLY | O_CLOEXEC))});
  }
};

// Signals to this thread, one after the other, each with a handler.
class SignalStorm {
 public:
  SignalStorm() {
    struct sigaction action {};
    action.sa_handler = [](int) {};
    ::sigaction(SIGUSR1, &action, &before_);
    sender_ = std::jthread([to = ::pthread_self()](const std::stop_token& stop) {
      while (!stop.stop_requested()) ::pthread_kill(to, SIGUSR1);
    });
  }
  ~SignalStorm() {
    sender_ = {};
    ::sigaction(SIGUSR1, &before_, nullptr);
  }
  SignalStorm(const SignalStorm&) = delete;
  SignalStorm& operator=(const SignalStorm&) = delete;

 private:
  struct sigaction before_ {};
  std::jthread sender_;
};

class SupervisorOnAMovedClock : public testing::Test {
 protected:
  // Runs the command until it ends; `then` comes once it sleeps.
  std::optional<int> run(std::vector<std::string> command, const std::function<void(pid_t)>& then) {
    return run(std::make_unique<Sleeps>(asked), std::move(command), then);
  }
  std::optional<int> run(std::unique_ptr<CallPart> part, std::vector<std::string> command,
                         const std::function<void(pid_t)>& then) {
    std::vector<std::unique_ptr<CallPart>> parts;
    parts.push_back(std::move(part));
    std::optional<int> status;
    SupervisedCommand::Trouble trouble;
    const auto running = SupervisedCommand::start(
        loop,
        {.command = std::move(command),
         .environment = {"PATH=/usr/bin:/bin"},
         .traps = Supervisor::traps(parts)},
        [&](int wait_status) { status = wait_status; }, trouble);
    if (!running) {
      ADD_FAILURE() << trouble.message;
      return std::nullopt;
    }
    const Supervisor supervisor(loop, running->take_listener(), std::move(parts));
    run_until(loop, [&] { return !asked.empty() || status; });
    then(running->command());
    run_until(loop, [&] { return status.has_value(); });
    return status;
  }

  ManualClock clock;
  Loop loop{clock};
  std::vector<Nanos> asked;
};

TEST_F(SupervisorOnAMovedClock, AnHourOfSleepIsOverWhenTheClockHasIt) {
  const auto status = run({"sleep", "3600"}, [this](pid_t) {
    EXPECT_EQ(loop.next_timer(), clock.now() + hours(1));
    clock.pass(hours(1));
    loop.clock_moved();
  });
  ASSERT_TRUE(status.has_value());
  EXPECT_TRUE(WIFEXITED(*status) && WEXITSTATUS(*status) == 0) << *status;
  EXPECT_EQ(asked, std::vector<Nanos>{hours(1)});
}

// An execve() ends all threads but one, and the process goes on.
TEST_F(SupervisorOnAMovedClock, TheCallOfAThreadThatEndsIsForgotten) {
  auto sleeps = std::make_unique<Sleeps>(asked);
  const int& gone = sleeps->gone();
  const std::string program =
      "import os, signal, threading, time\n"
      "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])\n"
      "threading.Thread(target=time.sleep, args=(3600,)).start()\n"
      "signal.sigwait([signal.SIGUSR1])\n"
      "os.execvp('sleep', ['sleep', '1800'])\n";
  const auto status = run(std::move(sleeps), {"python3", "-c", program}, [&](pid_t command) {
    ::kill(command, SIGUSR1);
    run_until(loop, [&] { return gone > 0 && asked.size() > 1; });
    EXPECT_EQ(gone, 1);
    ::kill(command, SIGKILL);
  });
  ASSERT_TRUE(status.has_value());
}

// The clock stands, and so would a look for signals that went by it.
TEST_F(SupervisorOnAMovedClock, ASignalInterruptsASleepWhileTheClockStands) {
  const Instant begin = clock.now();
  const auto status = run({"perl", "-e", "$SIG{USR1} = sub {}; sleep 3600; exit 7"},
                          [](pid_t command) { ::kill(command, SIGUSR1); });
  ASSERT_TRUE(status.has_value());
  EXPECT_TRUE(WIFEXITED(*status) && WEXITSTATUS(*status) == 7) << *status;
  EXPECT_EQ(clock.now(), begin);
}

// strace -p. That somebody traces it is in no mask of signals.
TEST_F(SupervisorOnAMovedClock, WhoBeginsToTraceAThreadGetsHoldOfIt) {
  const auto status = run({"sleep", "3600"}, [this](pid_t command) {
    // Its call has been looked at by then, as one of a thread that nobody traces.
    const Instant begin = machine_clock().now();
    run_until(loop, [&] { return machine_clock().now() - begin > 10 * KeptCalls::kLook; });
    std::atomic<int> seized{-1};
    int stop = 0;
    std::jthread tracer([&] {
      if (::ptrace(PTRACE_SEIZE, command, nullptr, nullptr) != 0) {
        seized = 0;
        return;
      }
      ::ptrace(PTRACE_INTERRUPT, command, nullptr, nullptr);
      ::waitpid(command, &stop, __WALL);
      ::ptrace(PTRACE_DETACH, command, nullptr, nullptr);
      seized = 1;
    });
    run_until(loop, [&] { return seized >= 0; });
    tracer.join();
    if (seized == 1) {
      EXPECT_EQ(stop >> 8, SIGTRAP | (PTRACE_EVENT_STOP << 8)) << stop;
      run_until(loop, [&] { return asked.size() > 1; });  // it sleeps on
    } else {
      std::puts("not tried: tracing is forbidden here");
    }
    ::kill(command, SIGKILL);
  });
  ASSERT_TRUE(status.has_value());
  EXPECT_TRUE(WIFSIGNALED(*status)) << *status;
}

// PTRACE_SEIZE alone interrupts nothing, and the program's call must not end for it.
TEST_F(SupervisorOnAMovedClock, WhoOnlySeizesAThreadEndsNoCall) {
  const auto status = run({"sleep", "3600"}, [this](pid_t command) {
    const Instant begin = machine_clock().now();
    run_until(loop, [&] { return machine_clock().now() - begin > 10 * KeptCalls::kLook; });
    std::atomic<int> seized{-1};
    int stop = 0;
    std::jthread tracer([&] {
      if (::ptrace(PTRACE_SEIZE, command, nullptr, nullptr) != 0) {
        seized = 0;
        return;
      }
      ::waitpid(command, &stop, __WALL);
      ::ptrace(PTRACE_DETACH, command, nullptr, nullptr);
      seized = 1;
    });
    run_until(loop, [&] { return seized >= 0; });
    tracer.join();
    if (seized == 1) {
      EXPECT_TRUE(WIFSTOPPED(stop) && WSTOPSIG(stop) == SIGURG) << stop;
      run_until(loop, [&] { return asked.size() > 1; });  // it sleeps on
    } else {
      std::puts("not tried: tracing is forbidden here");
    }
    ::kill(command, SIGKILL);
  });
  ASSERT_TRUE(status.has_value());
  EXPECT_TRUE(WIFSIGNALED(*status)) << *status;
}

// A signal that interrupts the supervisor while it gives a file, a stop among them, must not let the call
// end with a descriptor that is not that file.
TEST_F(SupervisorOnAMovedClock, AFileIsGivenWhateverSignalsTheSupervisorGets) {
  const SignalStorm storm;
  const auto status = run(std::make_unique<GivesFiles>(),
                          {"perl", "-e",
                           std::string("use Fcntl; for (1..3000) { sysopen(my $f, '") + kGiven +
                               "', O_RDONLY) or exit 8; fileno($f) > 2 or exit 9; close $f; } exit 7"},
                          [](pid_t) {});
  ASSERT_TRUE(status.has_value());
  EXPECT_TRUE(WIFEXITED(*status) && WEXITSTATUS(*status) == 7) << *status;
}

}  // namespace
}  // namespace porttape
