#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port.hpp"

namespace porttape {

// What the control socket steers: a daemon. The channel is named; empty means all of them.
class ControlTarget {
 public:
  // What came of a request: the channels that did it, and those that could not, with the reason.
  struct Outcome {
    std::vector<std::string> done;
    std::vector<std::pair<std::string, std::string>> refused;
  };

  // The keys of a reply to `status`, as a JSON object.
  [[nodiscard]] virtual std::string status() const = 0;
  // Errc::usage: there is no such channel. Errc::io: none of them could do it.
  virtual Result<Outcome> record(const std::string& channel, const RecorderRequest& what) = 0;
  virtual Result<Outcome> play(const std::string& channel, const PlaybackRequest& what) = 0;
  virtual Result<Outcome> stop(const std::string& channel) = 0;

 protected:
  ~ControlTarget() = default;
};

// The reply to one line of a client, without newlines (CONTROL.md). Whatever the line holds, the reply is a
// JSON object.
std::string control_reply(ControlTarget& target, std::string_view line);

// A reply that says no: it could not be done, or the request is wrong.
std::string control_error(std::string_view why);
std::string control_usage_error(std::string_view why);

}  // namespace porttape
