#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/supervise/call_filter.hpp"

namespace porttape {

// A command whose trapped calls wait for us. It is the child of a guard, a process of ours that has nothing
// else to do: when we end, however that happens, the guard ends all that the command has started, and as long
// as it lives no trapped call fails for want of a supervisor. Orphans fall to the guard. When the guard is
// killed, so is the command, and they fall to us. The command inherits what we have open without FD_CLOEXEC.
//
//     us ── guard ── command ── …
//
// Drive it: start(), then take_listener() for a Supervisor at once, since the command waits in its first
// trapped call; on_exit() comes once. Destroyed, it ends what is left. Loop thread only.
class SupervisedCommand {
 public:
  struct Options {
    std::vector<std::string> command;
    std::vector<std::string> environment;  // NAME=VALUE, all of it
    bool output_to_stderr = false;
    std::vector<CallTrap> traps;
    // Done in the guard before it starts the command, for what both are to have (a view of their own of the
    // file system): single-threaded, without log. An error is told by start().
    std::function<Result<void>()> prepare = {};
    // Signals that we ignore and the command is not to.
    std::vector<int> default_signals = {};
  };

  // What kept the command from running.
  struct Trouble {
    enum class Stage : std::uint8_t {
      prepare,   // Options::prepare: its error
      trap,      // trap_calls()
      exec,      // `error` is of execvpe()
      machinery  // no process or descriptor is to be had
    };
    Stage stage = Stage::machinery;
    int error = 0;
    std::string message = {};
  };
  // The status is wait()'s.
  using OnExit = std::function<void(int wait_status)>;

  // Waits until the command is about to run, or cannot.
  static std::unique_ptr<SupervisedCommand> start(Loop& loop, const Options& options, OnExit on_exit,
                                                  Trouble& trouble);
  ~SupervisedCommand();
  SupervisedCommand(const SupervisedCommand&) = delete;
  SupervisedCommand& operator=(const SupervisedCommand&) = delete;

  [[nodiscard]] UniqueFd take_listener() { return std::move(listener_); }
  [[nodiscard]] bool running() const { return command_ > 0; }
  [[nodiscard]] pid_t guard() const { return guard_; }
  [[nodiscard]] pid_t command() const { return command_; }
  void kill(int signal_number) const;

 private:
  SupervisedCommand(Loop& loop, pid_t guard, UniqueFd line, OnExit on_exit);
  bool wait_for_start(Trouble& trouble);
  void on_readable();
  void guard_gone();
  void ended(int wait_status);

  pid_t guard_;
  pid_t command_ = 0;
  UniqueFd line_;
  UniqueFd listener_;
  OnExit on_exit_;
  UniqueFd command_fd_;  // once the guard is gone: the command's own end
  std::optional<FdWatch> command_watch_;
  Loop* loop_;
  FdWatch watch_;
};

}  // namespace porttape
