#include "libport/tty/modem_watch.hpp"

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <ctime>
#include <exception>
#include <fcntl.h>
#include <mutex>
#include <sys/ioctl.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

// Its default is to be ignored: one that comes where nobody waits for it does no harm.
constexpr int kWakeSignal = SIGURG;
constexpr Nanos kLookAgain = milliseconds(100);
constexpr Nanos kPoll = milliseconds(10);
constexpr Nanos kUntilItEnds = milliseconds(1);
constexpr Nanos kNow{1};
// Waits in a row that ended though nothing had changed: such a driver is looked at by the clock.
constexpr int kMostIdle = 16;

struct ModemLine {
  LineSignal::Name name;
  int bit;
  int SignalCounts::*count;
};
constexpr std::array<ModemLine, 4> kModemLines = {{{LineSignal::Name::cts, TIOCM_CTS, &SignalCounts::cts},
                                                   {LineSignal::Name::dsr, TIOCM_DSR, &SignalCounts::dsr},
                                                   {LineSignal::Name::cd, TIOCM_CD, &SignalCounts::cd},
                                                   {LineSignal::Name::ri, TIOCM_RNG, &SignalCounts::ri}}};

void wake(int) {}

// Makes the wake-up's handler stand. False: a handler of somebody else does.
bool have_wake_handler() {
  struct sigaction old {};
  if (::sigaction(kWakeSignal, nullptr, &old) != 0) return false;
  if (old.sa_handler == wake) return true;
  if (old.sa_handler != SIG_DFL && old.sa_handler != SIG_IGN) return false;
  struct sigaction action {};
  action.sa_handler = wake;  // without SA_RESTART
  return ::sigaction(kWakeSignal, &action, nullptr) == 0;
}

// A timer of the kernel that sends the wake-up to the thread that made it.
class WakeTimer {
 public:
  WakeTimer() {
    sigevent event{};
    event.sigev_notify = SIGEV_THREAD_ID;
    event.sigev_signo = kWakeSignal;
    event._sigev_un._tid = ::gettid();
    made_ = ::timer_create(CLOCK_MONOTONIC, &event, &timer_) == 0;
  }
  ~WakeTimer() {
    if (made_) (void)::timer_delete(timer_);
  }
  WakeTimer(const WakeTimer&) = delete;
  WakeTimer& operator=(const WakeTimer&) = delete;

  [[nodiscard]] bool made() const { return made_; }
  void set(Nanos first, Nanos again) const {
    const itimerspec times{as_timespec(again), as_timespec(first)};
    (void)::timer_settime(timer_, 0, &times, nullptr);
  }

 private:
  static timespec as_timespec(Nanos time) {
    const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(time);
    return {seconds.count(), (time - seconds).count()};
  }

  timer_t timer_{};
  bool made_ = false;
};

// What was seen of the lines, and what a look at them tells.
class ModemLooks {
 public:
  explicit ModemLooks(std::optional<int> known) : lines_(known) {}

  std::vector<LineSignal> look(int lines, const std::optional<SignalCounts>& counts) {
    std::vector<LineSignal> seen;
    const auto tell = [&seen](const LineSignal& signal) { seen.push_back(signal); };
    if (counts && counts_ && lines_) {
      for (const ModemLine& line : kModemLines) {
        const bool on = (lines & line.bit) != 0;
        if (on != ((*lines_ & line.bit) != 0) || (*counts).*line.count == (*counts_).*line.count) continue;
        tell({line.name, !on});
        tell({line.name, on});
      }
    }
    tell_modem_lines(lines_, lines, tell);
    if (counts && counts_ && counts->breaks != counts_->breaks) {
      tell({LineSignal::Name::brk, true});
      tell({LineSignal::Name::brk, false});
    }
    lines_ = lines;
    counts_ = counts;
    return seen;
  }

 private:
  std::optional<int> lines_;
  std::optional<SignalCounts> counts_;
};

}  // namespace

int modem_bit(LineSignal::Name name) {
  for (const ModemLine& line : kModemLines) {
    if (line.name == name) return line.bit;
  }
  return 0;
}

void tell_modem_lines(std::optional<int> before, int lines, const ModemWatch::Tell& tell) {
  const int changed = before ? *before ^ lines : ~0;
  for (const ModemLine& line : kModemLines) {
    if ((changed & line.bit) != 0) tell({line.name, (lines & line.bit) != 0});
  }
}

// What the thread has, which outlives the watch if it must.
struct ModemWatch::Thread {
  void run();
  bool look();
  bool wait_for_change();
  [[nodiscard]] bool rest();

  std::shared_ptr<LineCalls> calls;
  UniqueFd fd;
  ModemLooks looks{std::nullopt};
  std::function<void(std::function<void()>)> post;
  std::weak_ptr<Tell> tell;
  int idle = 0;
  std::promise<void> leaves;
  std::shared_future<void> left = leaves.get_future().share();

  std::mutex mutex;                  // of what follows
  std::condition_variable wake_up;   // of a rest
  const WakeTimer* timer = nullptr;  // while the thread may wait in the driver
  bool stopping = false;
  bool look_wanted = false;
};

void ModemWatch::Thread::run() {
  {
    const WakeTimer own;
    {
      const std::lock_guard lock(mutex);
      if (own.made()) timer = &own;
      if (own.made()) own.set(kLookAgain, kLookAgain);
    }
    bool waits = own.made();
    while (look()) {
      if (waits) waits = wait_for_change();
      if (!waits && !rest()) break;
    }
    const std::lock_guard lock(mutex);
    timer = nullptr;
  }
  fd.reset();
  leaves.set_value();
}

// False: there is nothing more to see, or nobody who wants to.
bool ModemWatch::Thread::look() {
  const std::optional<int> lines = calls->modem_lines(fd.get());
  if (!lines) return false;
  const std::vector<LineSignal> seen = looks.look(*lines, calls->counts(fd.get()));
  if (!seen.empty()) {
    idle = 0;
    post([seen, wanted = tell] {
      for (const LineSignal& signal : seen) {
        // It may end the watch.
        if (const std::shared_ptr<Tell> whom = wanted.lock()) (*whom)(signal);
      }
    });
  }
  const std::lock_guard lock(mutex);
  return !stopping;
}

// False: the driver has no such wait.
bool ModemWatch::Thread::wait_for_change() {
  const int error = calls->wait_for_change(fd.get());
  return error == EINTR || (error == 0 && ++idle <= kMostIdle);
}

// False: it is to end.
bool ModemWatch::Thread::rest() {
  std::unique_lock lock(mutex);
  if (timer != nullptr) timer->set(Nanos{0}, Nanos{0});
  timer = nullptr;
  wake_up.wait_for(lock, kPoll, [this] { return stopping || look_wanted; });
  look_wanted = false;
  return !stopping;
}

std::unique_ptr<ModemWatch> ModemWatch::start(Loop& loop, std::shared_ptr<LineCalls> calls, int fd,
                                              std::optional<int> known, Tell tell) {
  if (!have_wake_handler()) return nullptr;
  const auto thread = std::make_shared<Thread>();
  thread->fd.reset(::fcntl(fd, F_DUPFD_CLOEXEC, 0));
  if (!thread->fd) return nullptr;
  thread->calls = std::move(calls);
  thread->looks = ModemLooks(known);
  thread->post = loop.poster();
  std::unique_ptr<ModemWatch> watch(new ModemWatch(thread));
  watch->tell_ = std::make_shared<Tell>(std::move(tell));
  thread->tell = watch->tell_;
  // Signals are the loop's, but for the one.
  sigset_t mask;
  sigset_t before;
  ::sigfillset(&mask);
  ::sigdelset(&mask, kWakeSignal);
  ::pthread_sigmask(SIG_SETMASK, &mask, &before);
  bool begun = true;
  try {
    std::thread([thread] { thread->run(); }).detach();
  } catch (const std::exception&) {  // none to be had
    begun = false;
  }
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
  if (begun) return watch;
  thread->fd.reset();
  return nullptr;
}

ModemWatch::ModemWatch(std::shared_ptr<Thread> thread) : thread_(std::move(thread)) {}

ModemWatch::~ModemWatch() {
  const std::lock_guard lock(thread_->mutex);
  thread_->stopping = true;
  if (thread_->timer != nullptr) thread_->timer->set(kNow, kUntilItEnds);
  thread_->wake_up.notify_all();
}

void ModemWatch::look_soon() {
  const std::lock_guard lock(thread_->mutex);
  thread_->look_wanted = true;
  if (thread_->timer != nullptr) thread_->timer->set(kNow, kLookAgain);
  thread_->wake_up.notify_all();
}

std::shared_future<void> ModemWatch::left() const { return thread_->left; }

}  // namespace porttape
