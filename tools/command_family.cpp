#include "tools/command_family.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <dirent.h>
#include <fcntl.h>
#include <memory>
#include <optional>
#include <poll.h>
#include <signal.h>
#include <sstream>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "libport/base/unique_fd.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kFewTicks = 2;  // of 10 ms

std::string read_proc_file(pid_t pid, const char* name) {
  const UniqueFd fd(::open(("/proc/" + std::to_string(pid) + '/' + name).c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd) return {};
  std::array<char, 4096> text{};
  const ssize_t n = ::read(fd.get(), text.data(), text.size());
  return n > 0 ? std::string(text.data(), static_cast<std::size_t>(n)) : std::string();
}

std::optional<ProcessState> state_of(pid_t pid) {
  ProcessState process;
  if (!parse_process_stat(read_proc_file(pid, "stat"), process)) return std::nullopt;
  return process;
}

bool traced(pid_t pid) {
  constexpr std::string_view key = "\nTracerPid:\t";
  const std::string status = read_proc_file(pid, "status");
  const std::size_t at = status.find(key);
  return at != std::string::npos && status.compare(at + key.size(), 2, "0\n") != 0;
}

std::map<pid_t, ProcessState> all_processes() {
  std::map<pid_t, ProcessState> found;
  const std::unique_ptr<DIR, int (*)(DIR*)> folder(::opendir("/proc"), ::closedir);
  if (!folder) return found;
  while (const dirent* entry = ::readdir(folder.get())) {
    if (entry->d_name[0] < '1' || entry->d_name[0] > '9') continue;
    if (const auto process = state_of(static_cast<pid_t>(std::stol(entry->d_name))))
      found.emplace(process->pid, *process);
  }
  return found;
}

bool any_child() {
  siginfo_t info{};
  return ::waitid(P_ALL, 0, &info, WEXITED | WNOHANG | WNOWAIT) == 0 || errno != ECHILD;
}

// Signals that very process, or none. glibc 2.36 declares these calls without extern "C".
void signal_process(const ProcessState& process, int number) {
  const UniqueFd fd(static_cast<int>(::syscall(SYS_pidfd_open, process.pid, 0)));
  if (!fd) return;
  const auto now = state_of(process.pid);  // of the process that `fd` stands for, or it has ended
  if (!now || now->started != process.started) return;
  (void)::syscall(SYS_pidfd_send_signal, fd.get(), number, nullptr, 0);
}

// Until one of them ends, or some time has passed.
void wait_for_one(const std::vector<ProcessState>& processes, Instant until) {
  std::vector<UniqueFd> owned;
  std::vector<pollfd> polled;
  for (const ProcessState& process : processes) {
    owned.emplace_back(static_cast<int>(::syscall(SYS_pidfd_open, process.pid, 0)));
    if (!owned.back() && errno == ESRCH) return;
    if (owned.back()) polled.push_back({.fd = owned.back().get(), .events = POLLIN, .revents = 0});
  }
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - verb_clock().now()).count();
  (void)::poll(polled.data(), polled.size(), static_cast<int>(std::clamp<std::int64_t>(left, 0, 100)));
}

bool contains(const std::vector<ProcessState>& list, const ProcessState& process) {
  return std::ranges::any_of(list, [&](const ProcessState& each) {
    return each.pid == process.pid && each.started == process.started;
  });
}

}  // namespace

bool parse_process_stat(std::string_view text, ProcessState& process) {
  const std::size_t open = text.find('(');
  const std::size_t close = text.rfind(')');  // a name may hold parentheses
  if (open == std::string_view::npos || close == std::string_view::npos || close < open) return false;
  process.name = text.substr(open + 1, close - open - 1);
  std::istringstream front{std::string(text.substr(0, open))};
  std::istringstream rest{std::string(text.substr(close + 1))};
  front >> process.pid;
  rest >> process.state >> process.parent;
  std::uint64_t user = 0;
  std::uint64_t system = 0;
  std::string skipped;
  for (int field = 5; field <= 13; ++field) rest >> skipped;
  rest >> user >> system;
  for (int field = 16; field <= 21; ++field) rest >> skipped;
  rest >> process.started;
  process.cpu_ticks = user + system;
  return !front.fail() && !rest.fail();
}

CommandFamily::~CommandFamily() {
  if (adopting_) ::prctl(PR_SET_CHILD_SUBREAPER, was_adopting_, 0, 0, 0);
}

Result<void> CommandFamily::adopt() {
  if (::prctl(PR_GET_CHILD_SUBREAPER, &was_adopting_, 0, 0, 0) != 0 ||
      ::prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0)
    return make_error(Errc::io, "following what the command starts: " + errno_text(errno));
  adopting_ = true;
  if (!any_child()) return {};
  for (const auto& [pid, process] : all_processes()) {
    if (process.parent == ::getpid()) before_.emplace(pid, process.started);
  }
  return {};
}

void CommandFamily::spare(pid_t child) {
  if (const auto process = state_of(child)) before_[child] = process->started;
}

void CommandFamily::look_through(pid_t child) { looked_through_ = state_of(child); }

bool CommandFamily::is_ours(const ProcessState& process,
                            const std::map<pid_t, ProcessState>& everybody) const {
  const ProcessState* at = &process;
  // Bounded: the pieces of a picture that was taken while it changed might form a circle.
  for (std::size_t steps = 0; steps < everybody.size(); ++steps) {
    if (at->parent == ::getpid()) {
      if (looked_through_ && at->pid == looked_through_->pid && at->started == looked_through_->started)
        return at != &process;
      const auto before = before_.find(at->pid);
      return before == before_.end() || before->second != at->started;
    }
    const auto parent = everybody.find(at->parent);
    if (parent == everybody.end()) return false;
    at = &parent->second;
  }
  return false;
}

std::vector<ProcessState> CommandFamily::members() const {
  const std::map<pid_t, ProcessState> everybody = all_processes();
  std::vector<ProcessState> found;
  for (const auto& [pid, process] : everybody) {
    if (is_ours(process, everybody)) found.push_back(process);
  }
  return found;
}

bool CommandFamily::awake() {
  std::map<pid_t, std::uint64_t> ticks;
  bool any = false;
  for (const ProcessState& process : members()) {
    const auto last = cpu_ticks_.find(process.pid);
    const bool worked = last == cpu_ticks_.end() || process.cpu_ticks - last->second > kFewTicks;
    const bool asleep = process.state == 'S' || process.state == 'Z';
    any = any || worked || !asleep || traced(process.pid);
    ticks.emplace(process.pid, process.cpu_ticks);
  }
  cpu_ticks_ = std::move(ticks);
  return any;
}

bool CommandFamily::debugged() const {
  return std::ranges::any_of(members(), [](const ProcessState& process) { return traced(process.pid); });
}

// Reaps the ended ones.
std::vector<ProcessState> CommandFamily::living() const {
  std::vector<ProcessState> processes = members();
  std::erase_if(processes, [](const ProcessState& process) {
    if (process.state != 'Z') return false;
    if (process.parent == ::getpid()) ::waitpid(process.pid, nullptr, WNOHANG);
    return true;
  });
  return processes;
}

CommandFamily::Ended CommandFamily::end(Nanos term_limit, Nanos kill_limit) {
  Ended result;
  const auto term_until = verb_clock().now() + term_limit;
  const auto kill_until = term_until + kill_limit;
  while (any_child()) {
    const std::vector<ProcessState> processes = living();
    if (processes.empty()) break;
    const auto now = verb_clock().now();
    if (now >= kill_until) {
      std::erase_if(result.ended, [&](const ProcessState& each) { return contains(processes, each); });
      result.left = processes;
      break;
    }
    for (const ProcessState& process : processes) {
      const bool is_new = !contains(result.ended, process);
      if (is_new) result.ended.push_back(process);
      if (now >= term_until) {
        signal_process(process, SIGKILL);
      } else if (is_new) {
        signal_process(process, SIGTERM);
        signal_process(process, SIGCONT);  // a stopped one
      }
    }
    wait_for_one(processes, now < term_until ? term_until : kill_until);
  }
  return result;
}

}  // namespace porttape
