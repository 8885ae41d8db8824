#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <spdlog/fwd.h>

#include "daemon/control_protocol.hpp"
#include "daemon/supervised_channel.hpp"
#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/signal_watch.hpp"

namespace porttape {

// The channels of one process and the signals that steer them: SIGTERM and SIGINT end them (a second one at
// once), SIGUSR1 starts their next tapes, SIGHUP reopens the log. SIGUSR2 does nothing.
//
// Drive it: start(), then run() until every channel has ended.
class Daemon final : public ControlTarget {
 public:
  struct Options {
    std::string verb = {};        // of the program, for its status
    bool keeps_channels = false;  // the verb `run`: a channel in trouble is retried, see SupervisedChannel
    bool ends_on_hang_up =
        false;  // SIGHUP ends the channels too: the terminal of a program in the foreground
    bool ignores_hang_up = false;  // SIGHUP was ignored when the program started (nohup)
    std::function<void()> reopen_log = [] {};
  };

  Daemon(Loop& loop, std::shared_ptr<spdlog::logger> log, Options options);
  ~Daemon();

  // Channels that are good by check_channels(): all or, where they are kept, as many as can be started now.
  Result<void> start(const std::map<std::string, ChannelSpec>& channels);

  // The exit status: the worst that a channel ended with.
  int run();

  // For the control socket.
  [[nodiscard]] std::string status() const override;
  Result<Outcome> record(const std::string& channel, const RecorderRequest& what) override;
  Result<Outcome> play(const std::string& channel, const PlaybackRequest& what) override;
  Result<Outcome> stop(const std::string& channel) override;

 private:
  struct Running {
    std::unique_ptr<SupervisedChannel> running;
    std::shared_ptr<LastTrouble> trouble;
  };

  template <class Request>
  Result<Outcome> ask(const std::string& channel, const Request& what, std::string_view none);
  void signalled(int number);
  void stop();
  [[nodiscard]] Result<std::vector<std::string>> running(const std::string& channel) const;
  void hung_up();
  void ended(const std::string& name, int exit_status);

  Loop* loop_;
  std::shared_ptr<spdlog::logger> log_;
  Options options_;
  std::map<std::string, Running> channels_;
  std::map<std::string, ChannelStatus> ended_;
  const WallTime since_;
  std::optional<SignalWatch> signals_;
  int exit_status_ = 0;
};

}  // namespace porttape
