#include "libport/supervise/pending_signals.hpp"

#include <array>
#include <charconv>
#include <csignal>
#include <fcntl.h>
#include <fmt/format.h>
#include <string_view>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <system_error>
#include <thread>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

// The part of /proc/PID/status that has signals lies within its first 2 KiB.
struct StatusText {
  std::array<char, 4096> room{};
  std::string_view text{};
};

StatusText status_of_thread(pid_t thread) {
  StatusText status;
  std::array<char, 64> path{};
  *fmt::format_to_n(path.data(), path.size() - 1, "/proc/{}/status", thread).out = '\0';
  const UniqueFd file(::open(path.data(), O_RDONLY | O_CLOEXEC));
  const ssize_t size = file ? ::read(file.get(), status.room.data(), status.room.size()) : -1;
  if (size > 0) status.text = {status.room.data(), static_cast<std::size_t>(size)};
  return status;
}

std::uint64_t number_behind(std::string_view text, std::string_view key, int base) {
  const std::size_t at = text.find(key);
  if (at == std::string_view::npos) return 0;
  std::uint64_t value = 0;
  const char* const begin = text.data() + at + key.size();
  (void)std::from_chars(begin, text.data() + text.size(), value, base);
  return value;
}

}  // namespace

ThreadStatus thread_status(pid_t thread) {
  const StatusText status = status_of_thread(thread);
  const std::string_view text(status.room.data(), status.text.size());
  constexpr std::string_view kState = "\nState:\t";
  const std::size_t state = text.find(kState);
  if (state == std::string_view::npos || state + kState.size() >= text.size()) return {};
  const auto tracer = static_cast<pid_t>(number_behind(text, "\nTracerPid:\t", 10));
  const std::uint64_t ignored = number_behind(text, "\nSigIgn:\t", 16);
  const std::uint64_t heard = tracer == 0 ? ~ignored : ~std::uint64_t{0};
  return {.state = text[state + kState.size()],
          .process = static_cast<pid_t>(number_behind(text, "\nTgid:\t", 10)),
          .threads = static_cast<unsigned>(number_behind(text, "\nThreads:\t", 10)),
          .tracer = tracer,
          .to_thread = number_behind(text, "\nSigPnd:\t", 16) & heard,
          .to_process = number_behind(text, "\nShdPnd:\t", 16) & heard,
          .blocked = number_behind(text, "\nSigBlk:\t", 16),
          .ignored = ignored,
          .caught = number_behind(text, "\nSigCgt:\t", 16),
          .queued = number_behind(text, "\nSigQ:\t", 10)};
}

// The end of the one who traces takes the interrupt back, and leaves what it has set.
bool have_signals_looked_for(pid_t thread) {
  bool done = false;
  try {
    std::thread tracer([thread, &done] {
      done = ::ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) == 0 &&
             ::ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr) == 0;
    });
    tracer.join();
  } catch (const std::system_error&) {
    return false;
  }
  return done;
}

// By default these do nothing; of a thread that is traced they are pending nevertheless, and its tracer sees
// them.
void send_what_does_nothing(pid_t thread, const ThreadStatus& status) {
  for (const int number : {SIGURG, SIGWINCH, SIGCHLD}) {
    const std::uint64_t bit = std::uint64_t{1} << static_cast<unsigned>(number - 1);
    if (((status.blocked | status.ignored | status.caught) & bit) != 0) continue;
    (void)::syscall(SYS_tgkill, status.process, thread, number);
    return;
  }
}

pid_t process_of(pid_t thread) { return thread_status(thread).process; }

}  // namespace porttape
