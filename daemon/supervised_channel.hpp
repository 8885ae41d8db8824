#pragma once

#include <functional>
#include <memory>
#include <string>

#include "daemon/channel_status.hpp"
#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/loop/fence.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/session/make_session.hpp"

namespace porttape {

// One channel of the daemon. What goes wrong in it stays in it: its device missing, its tape or its port that
// cannot be made, an exception out of one of its callbacks.
//
// With `retries` such trouble is told and a new session is made after 1 s, 2 s, 4 s, … 30 s; the channel ends
// by stop(), or when its session ends without trouble (a replay with --once). Otherwise it ends at the first
// trouble.
//
// Drive it: start(), then the loop; `on_end` comes once, from the loop, with the exit status, and may destroy
// the channel.
class SupervisedChannel {
 public:
  SupervisedChannel(PortContext context, ChannelSpec spec, bool retries,
                    std::function<void(int exit_status)> on_end);
  ~SupervisedChannel();
  SupervisedChannel(const SupervisedChannel&) = delete;
  SupervisedChannel& operator=(const SupervisedChannel&) = delete;

  // The error is this channel's end, and on_end does not come; none with `retries`.
  Result<void> start();
  void stop();  // as Session::stop()
  // Errc::usage: nothing is recorded, or it cannot be done now.
  Result<void> request(const RecorderRequest& what) { return ask(what); }
  // Errc::usage: no tape is played, or it cannot be done now.
  Result<void> request(const PlaybackRequest& what) { return ask(what); }
  [[nodiscard]] ChannelStatus status() const;

 private:
  template <class Request>
  Result<void> ask(const Request& what);
  Result<void> start_session();
  void drop_session();
  void session_ended(int exit_status);
  void threw(const std::string& what);
  void later(std::function<void()> task);
  void try_again(const std::string& why);
  void retry();
  void end(int exit_status);

  PortContext context_;
  ChannelSpec spec_;
  const bool retries_;
  std::function<void(int)> on_end_;
  std::shared_ptr<Fence> fence_;
  std::unique_ptr<Channel> session_;
  Channel::Counters before_;  // of the sessions before this one
  Timer retry_timer_;
  Nanos delay_;
  Instant started_{};    // the session's start
  std::string trouble_;  // as told last; empty while all is well
  bool broken_ = false;  // by an exception; the session is about to go
  bool stopping_ = false;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
