#pragma once

#include <cstdint>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port.hpp"

namespace porttape {

class Session;

// What joins drivers with devices, as a program drives it: a Session, or Connections, which has one for each
// driver.
//
// Drive it: start(), then the loop; stop() or what the ports ask for leads to `on_end`, which the constructor
// was given, with the exit status, once, from the loop. Loop thread only.
class Channel {
 public:
  struct Counters {
    std::uint64_t to_driver_bytes = 0;
    std::uint64_t from_driver_bytes = 0;
    std::uint64_t dropped_bytes = 0;  // reached nobody: the other side was not there or did not take them
    std::uint64_t opens = 0;
    std::uint64_t device_losses = 0;  // it could not be opened, or went away: told in the log

    Counters& operator+=(const Counters& other) {
      to_driver_bytes += other.to_driver_bytes;
      from_driver_bytes += other.from_driver_bytes;
      dropped_bytes += other.dropped_bytes;
      opens += other.opens;
      device_losses += other.device_losses;
      return *this;
    }
  };

  Channel() = default;
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;
  virtual ~Channel() = default;

  // Prepares the ports and waits for a driver. On an error nothing is left behind, and on_end does not come.
  virtual Result<void> start() = 0;
  // Passes on what has come in, completes tapes and reports, ends. Called again: ends at once.
  virtual void stop() = 0;
  // Errc::usage: nothing is recorded, or it cannot be done now.
  virtual Result<void> request(const RecorderRequest& what) = 0;
  // Errc::usage: no tape is played, or it cannot be done now.
  virtual Result<void> request(const PlaybackRequest& what) = 0;

  // Of all its sessions, those that have ended too.
  [[nodiscard]] virtual Counters counters() const = 0;
  // The port that drivers come to.
  [[nodiscard]] virtual Port& driver() = 0;
  // Those that there are now; valid until the loop runs on.
  [[nodiscard]] virtual std::vector<Session*> sessions() = 0;
};

}  // namespace porttape
