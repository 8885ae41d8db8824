#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include <boost/json/object.hpp>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "tools/control_place.hpp"

namespace porttape {

class CommandLine;

// A connection to the control socket of a daemon (daemon/CONTROL.md). Waits, kLimit at most for each answer.
class ControlClient {
 public:
  static constexpr std::chrono::seconds kLimit{2};

  // Nothing where no daemon has the socket any more; it is removed then, if its folder is our user's.
  // Errc::usage: it is another user's, or not that of the process of its name. Errc::io.
  static Result<std::optional<ControlClient>> connect(const ControlSocket& socket);

  [[nodiscard]] pid_t pid() const { return socket_.pid; }
  [[nodiscard]] const ControlSocket& socket() const { return socket_; }
  // The reply to a request, where it says `ok`. Errc::usage: the request is wrong, or not for us to make.
  // Errc::io: it could not be done, or the daemon does not answer; connect again then, since a late reply may
  // come.
  Result<boost::json::object> ask(const boost::json::object& request);
  // Waits for the daemon's end. False: it is there still.
  [[nodiscard]] bool wait_ended(Nanos limit) const;

 private:
  friend class DaemonSearch;
  ControlClient(UniqueFd fd, ControlSocket socket);
  Result<std::string> read_line();

  UniqueFd fd_;
  UniqueFd process_;
  ControlSocket socket_;
  std::string input_;
};

// The daemons that the user of a verb selects.
struct WantedDaemons {
  std::optional<pid_t> pid = {};  // only this process
  OtherUsers others = {};         // also the daemons of these users

  // Adds the options --pid and --user to a command line, and reads them. Errc::usage: a value is wrong.
  static void add_options(CommandLine& line);
  static Result<WantedDaemons> of(const CommandLine& line);
};

// What the daemons that run say of themselves.
struct RunningDaemon {
  ControlClient client;
  boost::json::object status;
};
struct RunningDaemons {
  std::vector<RunningDaemon> daemons;
  // Others: Errc::usage, that are not ours to ask; else that do not answer.
  std::vector<Error> silent;
};
// Asks all daemons at the same time, and returns after ControlClient::kLimit at the latest.
RunningDaemons find_daemons(const WantedDaemons& wanted);
// The message for the case that find_daemons() found none.
std::string no_daemon_text(const WantedDaemons& wanted);

// That of a daemon's status, or of a channel or line of it; empty and 0 where it is not there.
std::string text_of(const boost::json::object& object, std::string_view key);
std::int64_t number_of(const boost::json::object& object, std::string_view key);
// Its objects; others are left out.
boost::json::object object_of(const boost::json::object& object, std::string_view key);
std::vector<boost::json::object> objects_of(const boost::json::object& object, std::string_view key);

}  // namespace porttape
