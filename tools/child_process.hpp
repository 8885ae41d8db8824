#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "tools/command_end.hpp"
#include "tools/running_command.hpp"

namespace porttape {

// A command that was started with our stdin, stdout and stderr, in our process group, so that a debugger can
// use the terminal. Killed and reaped by the destructor. Loop thread only.
class ChildProcess final : public RunningCommand {
 public:
  using Environment = std::map<std::string, std::optional<std::string>>;  // none: not there

  enum class Output { ours, all_to_stderr };

  // Starts it, with `changed` of our environment; `on_exit` comes once, from the loop.
  // Errc::usage when there is no such command.
  static Result<std::unique_ptr<ChildProcess>> start(Loop& loop, const std::vector<std::string>& command,
                                                     const Environment& changed, Output output,
                                                     std::function<void()> on_exit);
  ~ChildProcess() override;
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  [[nodiscard]] bool running() const override { return pid_ > 0; }
  [[nodiscard]] const CommandEnd& end() const override { return end_; }
  void kill(int signal_number) const override;
  [[nodiscard]] bool in_our_group() const override;

  // For others that start commands: our environment with these changes, NAME=VALUE each; why a command cannot
  // be run, and what to do.
  static std::vector<std::string> environment_with(const Environment& changed);
  static Error cannot_run(const std::string& program, int error);
  // Signals that this program ignores and a command is not to.
  static const std::vector<int>& default_signals();

 private:
  ChildProcess(Loop& loop, pid_t pid, UniqueFd pid_fd, std::function<void()> on_exit);
  void reap();

  pid_t pid_;
  UniqueFd pid_fd_;
  std::function<void()> on_exit_;
  FdWatch watch_;
  CommandEnd end_;
};

}  // namespace porttape
