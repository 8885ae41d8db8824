#include <csignal>
#include <exception>
#include <iostream>
#include <string>
#include <sys/resource.h>
#include <utility>
#include <vector>

#include "daemon/background.hpp"
#include "daemon/daemon.hpp"
#include "daemon/invocation.hpp"
#include "daemon/log.hpp"
#include "daemon/notify.hpp"

namespace porttape {
namespace {

int fail(const Error& error) {
  std::cerr << "porttaped: " << error.message << '\n';
  return exit_status_of(error.code);
}

int run(const Invocation& line) {
  Background background;
  if (line.background) {
    const Result<std::optional<int>> child = background.start();
    if (!child) return fail(child.error());
    if (*child) return **child;
  }
  Result<std::shared_ptr<spdlog::logger>> log = make_log(line.log_file, line.log_level);
  if (!log) return fail(log.error());
  Loop loop;
  Daemon daemon(loop, *log, {.keeps_channels = line.keeps_channels});
  if (Result<void> started = daemon.start(line.channels); !started) return fail(started.error());
  PidFile pid_file;
  if (!line.pid_file.empty()) {
    if (Result<void> written = pid_file.write(line.pid_file); !written) return fail(written.error());
  }
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
    std::cerr << "porttaped: " << error.what() << '\n';
    return porttape::exit_status::kRuntime;
  }
}
