#include "tools/record_run.hpp"

#include <utility>

#include "libport/taped/types.hpp"

namespace porttape {

RecordRun::RecordRun(std::string_view name, ChannelPorts ports, std::vector<std::string> command,
                     std::optional<Supervision> supervision)
    : ports_(std::move(ports)),
      command_(std::move(command)),
      run_({.name = name,
            .log_level = spdlog::level::warn,
            .waits_after_signal = true,
            .supervision = supervision,
            .on_session_end = [this](int exit_status) { session_ended(exit_status); }}) {
  RecordingOptions recording = *ports_.device.get<RecordingOptions>();
  recording.on_ended = [this](const TapePaths& tape) { tapes_.push_back(tape); };
  ports_.device.set(std::move(recording));
}

Result<void> RecordRun::run() {
  if (Result<void> started = run_.start_session(ports_); !started) return started;
  if (Result<void> ran = run_.run_command(command_); !ran) return ran;
  run_.finish();
  return {};
}

// With --fail-closed a tape that fails ends all.
void RecordRun::session_ended(int exit_status) {
  if (exit_status == 0 || !run_.command_runs()) return;
  run_.notes().emplace_back("the line had to end, and so the command was ended");
  command_ended_ = true;
  run_.end_command();
}

}  // namespace porttape
