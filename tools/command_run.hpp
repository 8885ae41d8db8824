#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <spdlog/common.h>

#include "libport/catalog/channel.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/signal_watch.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/session/make_session.hpp"
#include "libport/supervise/supervisor.hpp"
#include "tools/child_process.hpp"
#include "tools/command_end.hpp"
#include "tools/command_family.hpp"
#include "tools/most_files.hpp"
#include "tools/running_command.hpp"
#include "tools/supervision.hpp"

namespace porttape {

// The command with `{port}` and, for a socket, `{host}` and `{tcp_port}` replaced.
std::vector<std::string> with_place(std::vector<std::string> command, const PortPlace& place);
// PORTTAPE_PORT and, for a socket, PORTTAPE_HOST and PORTTAPE_TCP_PORT; else not these.
ChildProcess::Environment environment_of(const PortPlace& place);

// A session with one command on its driver's port: starts both, waits for the command's end, ends the session
// and what the command left running. What it means is its owner's (TestRun, RecordRun).
//
// Drive it: start_session(), run_command(), finish(); after an error of one of them nothing more. SIGINT,
// SIGTERM, SIGHUP and SIGQUIT go to the command, a second one kills it, and one during finish() ends the
// session at once; SIGUSR1 begins the next tape. Loop thread only.
class CommandRun {
 public:
  struct Options {
    std::string_view name;  // before each line of the log, which goes to stderr
    spdlog::level::level_enum log_level = spdlog::level::err;
    bool waits_after_signal = false;  // for the command, however long; else it is killed after 5 s
    bool output_to_stderr = false;    // the command's stdout, too
    std::optional<Supervision> supervision = {};  // of the command, on a driver's port that is a tty
    std::function<void(int exit_status)> on_session_end = {};  // while the command runs, or later
  };

  explicit CommandRun(Options options);
  ~CommandRun();
  CommandRun(const CommandRun&) = delete;
  CommandRun& operator=(const CommandRun&) = delete;

  // On an error nothing is left behind.
  Result<void> start_session(const ChannelPorts& ports);
  // Errc::usage when there is no such command.
  Result<void> run_command(const std::vector<std::string>& command);
  void finish();

  // Asks the command to end, and kills it when it does not within 5 s. Only the first call counts.
  void end_command();
  [[nodiscard]] bool ends_command() const { return ending_; }
  void kill_command();
  [[nodiscard]] bool command_runs() const { return command_ && command_->running(); }
  [[nodiscard]] const CommandEnd& command_end() const { return command_->end(); }

  [[nodiscard]] Loop& loop() { return loop_; }
  [[nodiscard]] Channel* channel() { return channel_.get(); }  // null once it has ended
  [[nodiscard]] std::vector<Session*> sessions() {
    return channel_ ? channel_->sessions() : std::vector<Session*>();
  }
  [[nodiscard]] Channel::Counters counters() const { return channel_ ? channel_->counters() : counters_; }
  [[nodiscard]] int session_status() const { return session_status_; }
  [[nodiscard]] CommandFamily& family() { return family_; }
  // Of the user, who wanted it all to end; 0: none came.
  [[nodiscard]] int interrupted_by() const { return signal_; }
  // What the user should know besides, a line each; finish() adds what was left running.
  [[nodiscard]] std::vector<std::string>& notes() { return notes_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  Result<void> start_command(const std::vector<std::string>& command);
  Result<std::vector<std::unique_ptr<CallPart>>> supervising_parts();
  Result<bool> start_supervised(const std::vector<std::string>& command, PortPlace place,
                                ChildProcess::Output output);
  void watch_signals();
  void handle_ready();
  void wait_for_device();
  void signalled(int number);
  void session_ended(int exit_status);
  void end_what_is_left();

  Options options_;
  CommandFamily family_;
  Loop loop_;
  PortContext context_;
  std::unique_ptr<Channel> channel_;
  Channel::Counters counters_;  // of one that has ended
  std::unique_ptr<RunningCommand> command_;
  std::optional<MostFiles> most_files_;  // once it has started
  Timer kill_timer_;
  SignalWatch signals_;
  std::vector<std::string> notes_;
  int session_status_ = 0;
  int signal_ = 0;
  bool ending_ = false;
  bool finishing_ = false;
};

}  // namespace porttape
