#include "tools/command_family.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <dirent.h>
#include <fcntl.h>
#include <iterator>
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
#include "libport/base/whole_number.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kFewTicks = 2;  // of 10 ms
constexpr Nanos kChase = std::chrono::milliseconds(250);

// Opens a process's folder in /proc. The descriptor refers to that process even if another one gets its
// number.
UniqueFd open_process(pid_t number) {
  return UniqueFd(::open(("/proc/" + std::to_string(number)).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
}

std::string read_file(int folder, const char* name) {
  const UniqueFd fd(::openat(folder, name, O_RDONLY | O_CLOEXEC));
  if (!fd) return {};
  std::array<char, 4096> text{};
  const ssize_t n = ::read(fd.get(), text.data(), text.size());
  return n > 0 ? std::string(text.data(), static_cast<std::size_t>(n)) : std::string();
}

// How /proc shows us: under which number, and how many PID namespaces ours lies below its own.
struct View {
  pid_t self = 0;  // 0: not at all
  std::size_t depth = 0;
};

View view() {
  const UniqueFd folder(::open("/proc/self", O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder) return {};
  const std::vector<pid_t> numbers = numbers_of_process(read_file(folder.get(), "status"));
  // Where the last is not ours it is no /proc of this system.
  if (numbers.empty() || numbers.back() != ::getpid()) return {};
  return {numbers.front(), numbers.size() - 1};
}

std::optional<ProcessState> state_of(int folder, std::size_t depth) {
  ProcessState process;
  if (!parse_process_stat(read_file(folder, "stat"), process)) return std::nullopt;
  process.pid = process.number;
  if (depth == 0) return process;
  const std::vector<pid_t> numbers = numbers_of_process(read_file(folder, "status"));
  process.pid = depth < numbers.size() ? numbers[depth] : 0;  // 0: it is not in our namespace
  return process;
}

bool traced(const ProcessState& process) {
  constexpr std::string_view key = "\nTracerPid:\t";
  const std::string status = read_file(open_process(process.number).get(), "status");
  const std::size_t at = status.find(key);
  return at != std::string::npos && status.compare(at + key.size(), 2, "0\n") != 0;
}

// The children of this process's threads, by the numbers in /proc; where the kernel lists them.
std::vector<pid_t> children() {
  std::vector<pid_t> found;
  const std::unique_ptr<DIR, int (*)(DIR*)> threads(::opendir("/proc/self/task"), ::closedir);
  while (const dirent* thread = threads ? ::readdir(threads.get()) : nullptr) {
    const std::string list = std::string(thread->d_name) + "/children";
    std::istringstream numbers(read_file(::dirfd(threads.get()), list.c_str()));
    found.insert(found.end(), std::istream_iterator<pid_t>(numbers), std::istream_iterator<pid_t>());
  }
  return found;
}

std::map<pid_t, ProcessState> all_processes(const View& shown) {
  std::map<pid_t, ProcessState> found;
  const std::unique_ptr<DIR, int (*)(DIR*)> folder(::opendir("/proc"), ::closedir);
  if (!folder || shown.self == 0) return found;
  while (const dirent* entry = ::readdir(folder.get())) {
    const auto number = whole_number<pid_t>(entry->d_name);
    const UniqueFd its = number ? open_process(*number) : UniqueFd();
    const auto process = its ? state_of(its.get(), shown.depth) : std::nullopt;
    if (process) found.emplace(process->number, *process);
  }
  return found;
}

// A child of ours.
std::optional<ProcessState> find_child(pid_t child) {
  const View shown = view();
  if (shown.self != 0 && shown.depth == 0) return state_of(open_process(child).get(), 0);
  for (const auto& [number, process] : all_processes(shown)) {
    if (process.pid == child) return process;
  }
  return std::nullopt;
}

bool any_child() {
  siginfo_t info{};
  return ::waitid(P_ALL, 0, &info, WEXITED | WNOHANG | WNOWAIT) == 0 || errno != ECHILD;
}

// Signals exactly that process. pidfd_send_signal() accepts a process's folder in /proc in place of a
// descriptor of pidfd_open(). glibc 2.36 declares these calls without extern "C".
void signal_process(const ProcessState& process, int number) {
  const UniqueFd folder = open_process(process.number);
  const auto now = folder ? state_of(folder.get(), 0) : std::nullopt;
  if (!now || now->started != process.started || now->number != process.number) return;
  (void)::syscall(SYS_pidfd_send_signal, folder.get(), number, nullptr, 0);
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

// Of one that /proc hides (hidepid) only the number is known.
std::vector<ProcessState> states_of(const std::vector<pid_t>& numbers) {
  std::vector<ProcessState> all;
  for (const pid_t number : numbers) {
    const UniqueFd folder = open_process(number);
    const auto process = folder ? state_of(folder.get(), 0) : std::nullopt;
    all.push_back(process.value_or(ProcessState{.pid = number, .number = number, .name = "?"}));
  }
  return all;
}

bool contains(const std::vector<ProcessState>& list, const ProcessState& process) {
  return std::ranges::any_of(list, [&](const ProcessState& each) {
    return each.number == process.number && each.started == process.started;
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
  front >> process.number;
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

std::vector<pid_t> numbers_of_process(std::string_view status) {
  constexpr std::string_view key = "\nNSpid:";
  const std::size_t at = status.find(key);
  if (at == std::string_view::npos) return {};
  status.remove_prefix(at + key.size());
  std::istringstream line{std::string(status.substr(0, status.find('\n')))};
  return {std::istream_iterator<pid_t>(line), std::istream_iterator<pid_t>()};
}

CommandFamily::~CommandFamily() {
  if (adopting_) ::prctl(PR_SET_CHILD_SUBREAPER, was_adopting_, 0, 0, 0);
}

Result<void> CommandFamily::adopt() {
  if (::prctl(PR_GET_CHILD_SUBREAPER, &was_adopting_, 0, 0, 0) != 0 ||
      ::prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0)
    return make_error(Errc::io, "following what the command starts: " + errno_text(errno));
  adopting_ = true;
  others_ = any_child();
  if (!others_) return {};
  const View shown = view();
  for (const auto& [number, process] : all_processes(shown)) {
    if (process.parent == shown.self) before_.emplace(number, process.started);
  }
  return {};
}

void CommandFamily::spare(pid_t child) {
  others_ = true;
  if (const auto process = find_child(child)) before_[process->number] = process->started;
}

void CommandFamily::look_through(pid_t child) {
  others_ = true;
  looked_through_ = find_child(child);
}

bool CommandFamily::is_ours(const ProcessState& process, const Picture& everybody, pid_t self) const {
  const ProcessState* at = &process;
  // Bounded: the pieces of a picture that was taken while it changed might form a circle.
  for (std::size_t steps = 0; steps < everybody.size(); ++steps) {
    if (at->parent == self) {
      if (looked_through_ && at->number == looked_through_->number && at->started == looked_through_->started)
        return at != &process;
      const auto before = before_.find(at->number);
      return before == before_.end() || before->second != at->started;
    }
    const auto parent = everybody.find(at->parent);
    // Reading /proc takes a while. A parent that is younger than its child has the number of an ended
    // process.
    if (parent == everybody.end() || parent->second.started > at->started) return false;
    at = &parent->second;
  }
  return false;
}

std::vector<ProcessState> CommandFamily::members() const {
  const View shown = view();
  const Picture everybody = all_processes(shown);
  std::vector<ProcessState> found;
  for (const auto& [number, process] : everybody) {
    if (is_ours(process, everybody, shown.self)) found.push_back(process);
  }
  return found;
}

bool CommandFamily::awake() {
  std::map<pid_t, std::uint64_t> ticks;
  bool any = false;
  for (const ProcessState& process : members()) {
    const auto last = cpu_ticks_.find(process.number);
    const bool worked = last == cpu_ticks_.end() || process.cpu_ticks - last->second > kFewTicks;
    const bool asleep = process.state == 'S' || process.state == 'Z';
    any = any || worked || !asleep || traced(process);
    ticks.emplace(process.number, process.cpu_ticks);
  }
  cpu_ticks_ = std::move(ticks);
  return any;
}

bool CommandFamily::debugged() const {
  return std::ranges::any_of(members(), [](const ProcessState& process) { return traced(process); });
}

// Reaps the ended ones.
std::vector<ProcessState> CommandFamily::living() const {
  std::vector<ProcessState> processes = members();
  std::erase_if(processes, [](const ProcessState& process) {
    if (process.state != 'Z') return false;
    if (process.pid > 0) ::waitpid(process.pid, nullptr, WNOHANG);  // fails for a process that is not a child
    return true;
  });
  return processes;
}

// A child keeps its number until it is reaped, so the number is enough.
bool CommandFamily::is_spared(pid_t child) const {
  return before_.contains(child) || (looked_through_ && looked_through_->number == child);
}

std::vector<pid_t> CommandFamily::own_children() const {
  const View shown = view();
  if (shown.self == 0 || shown.depth > 0) return {};
  std::vector<pid_t> own = children();
  std::erase_if(own, [this](pid_t child) { return is_spared(child); });
  return own;
}

bool CommandFamily::chase(int signal, std::map<pid_t, int>& signalled,
                          std::vector<ProcessState>& ended) const {
  const Instant until = verb_clock().now() + kChase;
  for (bool any_new = true; any_new;) {
    any_new = false;
    for (const pid_t child : own_children()) {
      if (::waitpid(child, nullptr, WNOHANG) == child) {
        signalled.erase(child);
        continue;
      }
      const auto [at, is_new] = signalled.try_emplace(child, 0);
      if (std::exchange(at->second, signal) == signal) continue;
      any_new = true;
      ::kill(child, signal);
      if (!is_new) continue;
      const auto process = state_of(open_process(child).get(), 0);
      const auto alike = [&](const ProcessState& each) { return process && each.name == process->name; };
      if (process && std::ranges::none_of(ended, alike)) ended.push_back(*process);
    }
    if (any_new && verb_clock().now() >= until) return false;
  }
  return true;
}

CommandFamily::Ended CommandFamily::end(Nanos term_limit, Nanos kill_limit) {
  Ended result;
  const auto term_until = verb_clock().now() + term_limit;
  const auto kill_until = term_until + kill_limit;
  std::map<pid_t, int> chased;
  while (any_child()) {
    const std::vector<ProcessState> processes = living();
    const auto now = verb_clock().now();
    bool caught = true;
    if (processes.empty()) {  // of those that are to be seen
      if (own_children().empty()) {
        result.unseen = !others_ && any_child();
        break;
      }
      caught = chase(now < term_until ? SIGTERM : SIGKILL, chased, result.ended);
    }
    const std::vector<ProcessState> there = processes.empty() ? states_of(own_children()) : processes;
    if (there.empty()) continue;
    if (now >= kill_until) {
      std::erase_if(result.ended, [&](const ProcessState& each) { return contains(there, each); });
      result.left = there;
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
    if (caught) wait_for_one(there, now < term_until ? term_until : kill_until);
  }
  return result;
}

}  // namespace porttape
