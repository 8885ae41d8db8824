#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <list>
#include <memory>
#include <sys/types.h>

#include <spdlog/fwd.h>

#include "daemon/control_listener.hpp"
#include "daemon/control_protocol.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/fence.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// Serves the control socket of CONTROL.md on a loop, beside the lines that the loop is there for: whatever
// clients do, they get a twentieth of its time and bounded memory. There are kMostClients of them; one more
// takes the place of the one that was silent for the longest time. Of a client at most a line and what came
// with it is kept, and one that does not take its reply is not read.
//
// What goes wrong in it, exceptions included, is told in the log and ends with its clients. Loop thread only.
class ControlServer {
 public:
  static constexpr std::size_t kMostClients = 16;
  static constexpr std::size_t kMostLine = std::size_t{32} << 10;  // bytes of a request
  // It works for about so long, and then rests 19 times as long, kShortestRest at least.
  static constexpr Nanos kTurn = std::chrono::microseconds(300);
  static constexpr int kRest = 19;
  static constexpr Nanos kShortestRest = std::chrono::microseconds(200);

  struct Options {
    // Whether this user may ask; by default the daemon's own and root.
    std::function<bool(uid_t)> admits = {};
  };

  // `target` outlives it.
  ControlServer(Loop& loop, std::shared_ptr<spdlog::logger> log, ControlTarget& target,
                ControlListener listener, Options options);
  ControlServer(Loop& loop, std::shared_ptr<spdlog::logger> log, ControlTarget& target,
                ControlListener listener)
      : ControlServer(loop, std::move(log), target, std::move(listener), Options{}) {}
  ~ControlServer();
  ControlServer(const ControlServer&) = delete;
  ControlServer& operator=(const ControlServer&) = delete;

 private:
  struct Client;

  void work();
  Nanos accept();
  void make_room();
  bool serve(Client& client);
  void rest(Instant until);
  void listen();
  void wake();
  void threw(const std::string& what);

  Loop* loop_;
  std::shared_ptr<spdlog::logger> log_;
  ControlTarget* target_;
  ControlListener listener_;
  Options options_;
  std::shared_ptr<Fence> fence_;
  std::unique_ptr<FdWatch> watch_;
  std::unique_ptr<Timer> rest_timer_;
  std::list<std::unique_ptr<Client>> clients_;  // the next to be served first
  bool accept_told_ = false;                    // that it fails
  bool broken_ = false;                         // by an exception
};

}  // namespace porttape
