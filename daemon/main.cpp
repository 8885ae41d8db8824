#include <csignal>
#include <exception>
#include <fcntl.h>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <poll.h>
#include <string>
#include <sys/resource.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <spdlog/logger.h>

#include "daemon/background.hpp"
#include "daemon/control_server.hpp"
#include "daemon/daemon.hpp"
#include "daemon/invocation.hpp"
#include "daemon/log.hpp"
#include "daemon/notify.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

// A line on stderr, unless that is blocked.
void tell(const std::string& text) {
  const std::string line = "porttaped: " + printable_lines(text) + '\n';
  pollfd poll{STDERR_FILENO, POLLOUT, 0};
  if (::poll(&poll, 1, 1000) > 0) (void)!::write(STDERR_FILENO, line.data(), line.size());
}

int fail(const Error& error) {
  tell(error.message);
  return exit_status_of(error.code);
}

// Whether a terminal's end is ours: it is in the foreground and has a controlling terminal.
bool ends_with_terminal(const Invocation& line) {
  return !line.background && !line.keeps_channels &&
         UniqueFd(::open("/dev/tty", O_RDWR | O_CLOEXEC | O_NOCTTY));
}

bool ignores_hang_up() {
  struct sigaction action {};
  return ::sigaction(SIGHUP, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

// The control socket. Without one the lines work all the same.
class Control {
 public:
  explicit Control(std::shared_ptr<spdlog::logger> log) : log_(std::move(log)) {
    attempt([this]() -> Result<void> {
      Result<ControlListener> made =
          ControlListener::create(control_folder(ControlEnvironment::of_process()));
      if (!made) return made.error();
      listener_.emplace(std::move(*made));
      return {};
    });
  }
  void serve(Loop& loop, Daemon& daemon) {
    if (!listener_) return;
    attempt([&]() -> Result<void> {
      server_.emplace(loop, log_, daemon, std::move(*listener_));
      return {};
    });
  }

 private:
  void attempt(const std::function<Result<void>()>& step) {
    std::string trouble;
    try {
      const Result<void> done = step();
      if (done) return;
      trouble = done.error().message;
    } catch (const std::exception& error) {  // no memory
      trouble = error.what();
    }
    log_->warn("{}; porttape status and ctl do not find this daemon", trouble);
  }

  std::shared_ptr<spdlog::logger> log_;
  std::optional<ControlListener> listener_;
  std::optional<ControlServer> server_;
};

int run(const Invocation& line) {
  Background background;
  const bool ends_on_hang_up = ends_with_terminal(line);
  if (line.background) {
    const Result<std::optional<int>> child = background.start();
    if (!child) return fail(child.error());
    if (*child) return **child;
  }
  const Result<Log> log = make_log({.file = line.log_file, .background = line.background}, line.log_level);
  if (!log) return fail(log.error());
  Loop loop;
  Daemon daemon(loop, log->logger,
                {.verb = line.verb,
                 .keeps_channels = line.keeps_channels,
                 .ends_on_hang_up = ends_on_hang_up,
                 .ignores_hang_up = ignores_hang_up(),
                 .reopen_log = log->reopen});
  // Before the channels, whose descriptors it would take else where these are few.
  Control control(log->logger);
  if (Result<void> started = daemon.start(line.channels); !started) return fail(started.error());
  PidFile pid_file;
  if (!line.pid_file.empty()) {
    if (Result<void> written = pid_file.write(line.pid_file); !written) return fail(written.error());
  }
  control.serve(loop, daemon);
  if (line.background && line.log_file.empty()) tell("the log goes to " + log->place);
  background.ready();
  notify_systemd("READY=1");
  const int status = daemon.run();
  notify_systemd("STOPPING=1");
  return status;
}

// Each channel needs a few descriptors, and the soft limit is low for programs that use select().
void raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == limit.rlim_max) return;
  limit.rlim_cur = limit.rlim_max;
  (void)::setrlimit(RLIMIT_NOFILE, &limit);  // where it is refused, the channels that find no room say so
}

int main_of(const std::vector<std::string>& arguments) {
  // A reader that goes away, and a limit on the size of files, are errors of a write, not the end of the
  // line.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  const Result<Invocation> line = parse_invocation(arguments);
  if (!line) return fail(line.error());
  if (line->print) {
    std::cout << *line->print << std::flush;
    return std::cout ? 0 : exit_status::kRuntime;
  }
  raise_descriptor_limit();
  return run(*line);
}

}  // namespace
}  // namespace porttape

int main(int argc, char** argv) {
  try {
    return porttape::main_of(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::exception& error) {
    std::cerr << "porttaped: " << porttape::printable_lines(error.what()) << '\n';
    return porttape::exit_status::kRuntime;
  }
}
