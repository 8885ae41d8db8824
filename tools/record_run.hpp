#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/catalog/channel.hpp"
#include "libport/tape/tape_name.hpp"
#include "tools/command_run.hpp"

namespace porttape {

// One run of a command on its device, with a tape of it. Call run() once.
class RecordRun {
 public:
  // `ports.device` is one that records. `name` is before each line of the log, and must live on.
  RecordRun(std::string_view name, ChannelPorts ports, std::vector<std::string> command,
            std::optional<Supervision> supervision);
  RecordRun(const RecordRun&) = delete;
  RecordRun& operator=(const RecordRun&) = delete;

  Result<void> run();

  // After run().
  [[nodiscard]] const CommandEnd& command_end() const { return run_.command_end(); }
  [[nodiscard]] bool opened() const { return run_.counters().opens > 0; }
  // What was made, each closed, in the order in which they ended.
  [[nodiscard]] const std::vector<TapePaths>& tapes() const { return tapes_; }
  // A tape could not be made, or not be written to its end: told in the log.
  [[nodiscard]] bool tape_failed() const { return run_.session_status() != 0; }
  // … and with --fail-closed the command was ended for it.
  [[nodiscard]] bool command_ended() const { return command_ended_; }
  // The device could not be opened, or went away: told in the log.
  [[nodiscard]] bool device_failed() const { return run_.counters().device_losses > 0; }
  // What the user should know besides, a line each.
  [[nodiscard]] const std::vector<std::string>& notes() const { return run_.notes(); }

 private:
  void session_ended(int exit_status);

  ChannelPorts ports_;
  std::vector<std::string> command_;
  std::vector<TapePaths> tapes_;
  bool command_ended_ = false;
  CommandRun run_;
};

}  // namespace porttape
