#include "tools/job_worker.hpp"

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <exception>
#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "tools/command_end.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

// Between SIGTERM and SIGKILL: a command under test has its own limits, which are below it.
constexpr std::chrono::seconds kGrace(20);

// A message between parent and worker: its length, then a result's kind, then the text.
constexpr char kResult = 'R';
constexpr char kTrouble = 'T';

std::string framed(std::string_view text) {
  const std::uint64_t size = text.size();
  std::string frame(sizeof size, '\0');
  std::memcpy(frame.data(), &size, sizeof size);
  return frame.append(text);
}

// Takes a whole message from the front of `bytes`.
std::optional<std::string> take_frame(std::string& bytes) {
  std::uint64_t size = 0;
  if (bytes.size() < sizeof size) return std::nullopt;
  std::memcpy(&size, bytes.data(), sizeof size);
  if (bytes.size() - sizeof size < size) return std::nullopt;
  std::string text = bytes.substr(sizeof size, size);
  bytes.erase(0, sizeof size + size);
  return text;
}

// The worker's own side; both wait.

std::optional<std::string> next_job(int line) {
  std::string bytes;
  std::array<char, 65536> some{};
  for (;;) {
    if (auto job = take_frame(bytes)) return job;
    const ssize_t n = ::read(line, some.data(), some.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return std::nullopt;
    bytes.append(some.data(), static_cast<std::size_t>(n));
  }
}

bool hand_back(int line, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(line, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return true;
}

std::string outcome_of(const JobWork& work, const std::string& job) {
  try {
    return kResult + work(job);
  } catch (const std::exception& failure) {
    return kTrouble + std::string(failure.what());
  }
}

// What the signals that end a program do here; a job that handles them leaves its handlers behind.
class EndingSignals {
 public:
  EndingSignals() {
    for (std::size_t i = 0; i < kNumbers.size(); ++i) (void)::sigaction(kNumbers.at(i), nullptr, &at_.at(i));
  }
  void restore() const {
    for (std::size_t i = 0; i < kNumbers.size(); ++i) (void)::sigaction(kNumbers.at(i), &at_.at(i), nullptr);
  }

 private:
  static constexpr std::array kNumbers = {SIGINT, SIGTERM, SIGHUP, SIGQUIT};
  std::array<struct sigaction, kNumbers.size()> at_ = {};
};

[[noreturn]] void serve(int line, int output, const JobWork& work, pid_t parent) {
  (void)::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) ::_exit(1);  // it has died before
  const int nothing = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  const bool ready = nothing >= 0 && ::dup2(nothing, STDIN_FILENO) >= 0 &&
                     ::dup2(output, STDOUT_FILENO) >= 0 && ::dup2(output, STDERR_FILENO) >= 0;
  if (!ready) ::_exit(1);
  ::close(output);
  const EndingSignals signals;
  while (const auto job = next_job(line)) {
    const std::string outcome = outcome_of(work, *job);
    signals.restore();
    if (!hand_back(line, framed(outcome))) break;
  }
  ::_exit(0);  // what the parent had not written yet is the parent's to write
}

bool pair_of_ends(UniqueFd& one, UniqueFd& other) {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) return false;
  one.reset(ends[0]);
  other.reset(ends[1]);
  return true;
}

bool pipe_of_ends(UniqueFd& read, UniqueFd& write) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) return false;
  read.reset(ends[0]);
  write.reset(ends[1]);
  return true;
}

bool never_wait(const UniqueFd& fd) { return ::fcntl(fd.get(), F_SETFL, O_NONBLOCK) == 0; }

}  // namespace

Result<std::unique_ptr<JobWorker>> JobWorker::start(const JobWork& work,
                                                    const std::function<void()>& in_child) {
  UniqueFd line;
  UniqueFd its_line;
  UniqueFd output;
  UniqueFd its_output;
  const bool ready = pair_of_ends(line, its_line) && pipe_of_ends(output, its_output) && never_wait(line) &&
                     never_wait(output);
  const pid_t parent = ::getpid();
  const pid_t pid = ready ? ::fork() : -1;
  if (pid < 0) return make_error(Errc::io, "no process can be started: " + errno_text(errno));
  if (pid == 0) {
    in_child();
    line.reset();
    output.reset();
    serve(its_line.get(), its_output.release(), work, parent);
  }
  // glibc 2.36 declares pidfd_open() without extern "C".
  UniqueFd pid_fd(static_cast<int>(::syscall(SYS_pidfd_open, pid, 0)));
  if (!pid_fd) {
    const int error = errno;
    ::kill(pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
    return make_error(Errc::io, "watching a process: " + errno_text(error));
  }
  return std::unique_ptr<JobWorker>(
      new JobWorker(pid, std::move(pid_fd), std::move(line), std::move(output)));
}

JobWorker::JobWorker(pid_t pid, UniqueFd pid_fd, UniqueFd line, UniqueFd output)
    : pid_(pid), pid_fd_(std::move(pid_fd)), line_(std::move(line)), output_(std::move(output)) {}

JobWorker::~JobWorker() {
  kill();
  if (pid_ > 0) (void)reap();
}

void JobWorker::give(std::size_t job, std::string_view text, std::optional<Instant> until, std::string why) {
  job_ = job;
  text_ = {};
  outgoing_ = framed(text);
  deadline_ = until;
  late_ = std::move(why);
  write_some();
}

void JobWorker::add_to(std::vector<pollfd>& polled) const {
  const bool writes = !outgoing_.empty();
  if (pid_fd_) polled.push_back({.fd = pid_fd_.get(), .events = POLLIN, .revents = 0});
  if (line_)
    polled.push_back(
        {.fd = line_.get(), .events = static_cast<short>(writes ? POLLIN | POLLOUT : POLLIN), .revents = 0});
  if (output_) polled.push_back({.fd = output_.get(), .events = POLLIN, .revents = 0});
}

std::optional<JobDone> JobWorker::look() {
  if (gone_) return std::nullopt;
  const bool ended = has_ended();  // then all that it wrote is there
  write_some();
  read_some();
  read_output();
  gone_ = gone_ || ended;
  if (auto done = take_done()) return done;
  if (deadline_ && verb_clock().now() >= *deadline_) {
    asked_ ? kill_late() : end(SIGTERM, late_);
  }
  return std::nullopt;
}

bool JobWorker::has_ended() const {
  pollfd polled{.fd = pid_fd_.get(), .events = POLLIN, .revents = 0};
  return ::poll(&polled, 1, 0) > 0;
}

void JobWorker::write_some() {
  while (!outgoing_.empty()) {
    const ssize_t n = ::send(line_.get(), outgoing_.data(), outgoing_.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;  // its end, too, is seen by reading
    outgoing_.erase(0, static_cast<std::size_t>(n));
  }
}

void JobWorker::read_some() {
  std::array<char, 65536> some{};
  for (;;) {
    const ssize_t n = ::read(line_.get(), some.data(), some.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n <= 0) {
      gone_ = true;
      return;
    }
    incoming_.append(some.data(), static_cast<std::size_t>(n));
  }
}

// What is there now: whoever writes without end must not keep us here.
void JobWorker::read_output() {
  int size = 0;
  if (!output_ || ::ioctl(output_.get(), FIONREAD, &size) != 0) return;
  std::string some(static_cast<std::size_t>(size) + 1, '\0');
  const ssize_t n = ::read(output_.get(), some.data(), some.size());
  if (n > 0) text_.add(std::string_view(some).substr(0, static_cast<std::size_t>(n)));
  if (n == 0) output_.reset();
}

std::optional<JobDone> JobWorker::take_done() {
  auto frame = take_frame(incoming_);
  if ((!frame && !gone_) || !job_) return std::nullopt;
  JobDone done{.job = *job_, .result = {}, .output = text_.text(), .trouble = {}};
  if (!frame) {
    const std::string how = reap();
    done.trouble = why_.empty() ? "its process " + how : why_;
  } else if (frame->front() == kResult && why_.empty()) {
    done.result = frame->substr(1);
  } else {
    done.trouble = why_.empty() ? frame->substr(1) : why_;
  }
  job_.reset();
  deadline_.reset();
  if (asked_) close();
  return done;
}

void JobWorker::close() {
  (void)::shutdown(line_.get(), SHUT_WR);
  if (!busy()) gone_ = true;
}

void JobWorker::end(int signal_number, std::string why) {
  if (!asked_) why_ = std::move(why);
  asked_ = true;
  deadline_ = verb_clock().now() + kGrace;
  if (pid_ > 0 && signal_number != 0) ::kill(pid_, signal_number);
}

void JobWorker::kill_late() {
  kill();
  deadline_.reset();
}

void JobWorker::kill() {
  if (pid_ > 0) ::kill(pid_, SIGKILL);
}

void JobWorker::forget() {
  pid_ = 0;
  pid_fd_.reset();
  line_.reset();
  output_.reset();
}

std::string JobWorker::reap() {
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  pid_ = 0;
  return (WIFSIGNALED(status) ? CommandEnd{.signal = WTERMSIG(status)}
                              : CommandEnd{.status = WEXITSTATUS(status)})
      .text();
}

}  // namespace porttape
