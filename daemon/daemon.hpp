#pragma once

#include <map>
#include <memory>
#include <string>

#include "libport/base/result.hpp"
#include "libport/port/context.hpp"
#include "libport/session/channel.hpp"
#include "libport/session/session.hpp"

namespace porttape {

// The channels of one process and the signals that steer them: SIGTERM and SIGINT end them (a second one at
// once), SIGHUP starts their next tapes.
//
// Drive it: start(), then run() until every channel has ended.
class Daemon {
 public:
  Daemon(Loop& loop, std::shared_ptr<spdlog::logger> log);
  ~Daemon();

  // All channels or none.
  Result<void> start(const std::map<std::string, ChannelSpec>& channels);

  // The exit status: that of the first channel that ended with one other than 0.
  int run();

 private:
  struct Signals;

  void stop();
  void rotate();
  void ended(const std::string& name, int exit_status);

  Loop* loop_;
  std::shared_ptr<spdlog::logger> log_;
  std::map<std::string, std::unique_ptr<Session>> sessions_;
  std::unique_ptr<Signals> signals_;
  int exit_status_ = 0;
};

}  // namespace porttape
