#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/loop/loop.hpp"
#include "libport/supervise/device_view.hpp"
#include "libport/supervise/supervised_command.hpp"
#include "libport/supervise/supervisor.hpp"
#include "tools/child_process.hpp"
#include "tools/running_command.hpp"

namespace porttape {

// A command under a supervisor of ours with these parts.
class SupervisedChild final : public RunningCommand {
 public:
  struct Start {
    std::vector<std::string> command;
    ChildProcess::Environment environment;  // what is changed in ours
    ChildProcess::Output output = ChildProcess::Output::ours;
    std::optional<DevicePort> found_as = {};  // by the command, where that was found possible
  };

  // Where that cannot be here (the machine forbids it), there is none, and `forbidden` says why. `tell` is
  // given what the user should know, while the command runs. Errc::usage when there is no such command.
  static Result<std::unique_ptr<SupervisedChild>> start(Loop& loop,
                                                        std::vector<std::unique_ptr<CallPart>> parts,
                                                        const Start& how, std::string& forbidden,
                                                        const std::function<void(const std::string&)>& tell);
  ~SupervisedChild() override = default;

  [[nodiscard]] bool running() const override { return command_->running(); }
  [[nodiscard]] const CommandEnd& end() const override { return end_; }
  void kill(int signal_number) const override { command_->kill(signal_number); }
  [[nodiscard]] bool in_our_group() const override;
  // The process between us and the command.
  [[nodiscard]] pid_t guard() const { return command_->guard(); }

 private:
  SupervisedChild() = default;

  CommandEnd end_;
  // Goes after the command: trapped calls without a supervisor fail.
  std::unique_ptr<Supervisor> supervisor_;
  std::unique_ptr<SupervisedCommand> command_;
};

}  // namespace porttape
