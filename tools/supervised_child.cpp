#include "tools/supervised_child.hpp"

#include <fmt/format.h>
#include <functional>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "libport/supervise/lost_rights.hpp"
#include "libport/supervise/own_supervisors.hpp"

namespace porttape {
namespace {

using Stage = SupervisedCommand::Trouble::Stage;

Error started_not(const SupervisedCommand::Trouble& trouble, const std::string& program) {
  if (trouble.stage == Stage::exec) return ChildProcess::cannot_run(program, trouble.error);
  if (trouble.error == 0) return make_error(Errc::io, trouble.message);
  return make_error(Errc::io, fmt::format("{}: {}", trouble.message, errno_text(trouble.error)));
}

}  // namespace

Result<std::unique_ptr<SupervisedChild>> SupervisedChild::start(
    Loop& loop, std::vector<std::unique_ptr<CallPart>> parts, const Start& how, std::string& forbidden,
    const std::function<void(const std::string&)>& tell) {
  parts.push_back(std::make_unique<OwnSupervisors>(tell));
  ChildProcess::Environment environment = how.environment;
  std::function<Result<void>()> prepare;
  if (how.found_as) {
    environment.emplace(kDeviceViewVariable.first, kDeviceViewVariable.second);
    prepare = [&how] { return enter_device_view({*how.found_as}); };
  }
  const SupervisedCommand::Options options{
      .command = how.command,
      .environment = ChildProcess::environment_with(environment),
      .output_to_stderr = how.output == ChildProcess::Output::all_to_stderr,
      .traps = Supervisor::traps(parts),
      .prepare = std::move(prepare),
      .default_signals = ChildProcess::default_signals()};
  std::unique_ptr<SupervisedChild> child(new SupervisedChild());
  SupervisedCommand::Trouble trouble;
  child->command_ = SupervisedCommand::start(
      loop, options,
      [made = child.get()](int status) {
        made->end_ = WIFSIGNALED(status) ? CommandEnd{.signal = WTERMSIG(status)}
                                         : CommandEnd{.status = WEXITSTATUS(status)};
      },
      trouble);
  if (!child->command_) {
    if (trouble.stage != Stage::trap) return started_not(trouble, how.command.front());
    forbidden = trouble.message;
    return std::unique_ptr<SupervisedChild>();
  }
  if (const std::string lost = lost_rights(how.command.front()); !lost.empty()) tell(lost);
  child->supervisor_ = std::make_unique<Supervisor>(loop, child->command_->take_listener(), std::move(parts));
  return child;
}

bool SupervisedChild::in_our_group() const {
  return running() && ::getpgid(command_->command()) == ::getpgrp();
}

}  // namespace porttape
