#pragma once

#include <chrono>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <spdlog/sinks/sink.h>

#include "libport/base/json_object.hpp"
#include "libport/base/time.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/session/session.hpp"

namespace porttape {

// A moment as RFC 3339 has it, in UTC.
std::string wall_text(WallTime time);

// The last line of a channel's log that was a warning or worse. Any thread may call.
class LastTrouble final : public spdlog::sinks::sink {
 public:
  struct Told {
    WallTime at{};
    std::string text;
  };

  LastTrouble() { set_level(spdlog::level::warn); }
  [[nodiscard]] std::optional<Told> told() const;

  void log(const spdlog::details::log_msg& message) override;
  void flush() override {}
  void set_pattern(const std::string&) override {}
  void set_formatter(std::unique_ptr<spdlog::formatter>) override {}

 private:
  mutable std::mutex mutex_;
  std::optional<Told> told_;
};

// One line of a channel: a driver's port and a device's.
struct LineStatus {
  Session::State state = Session::State::waiting;
  std::string driver;       // the port's name
  std::string driver_node;  // what the driver opens, where that is a device node
  std::string device;
  std::optional<RecordingStatus> recording;
  std::optional<PlaybackStatus> playback = {};
};
LineStatus status_of(Session& session);

// A channel as `porttape status` tells of it (CONTROL.md).
struct ChannelStatus {
  std::string mode;  // record, replay, bridge
  std::string driver;
  std::string device;                  // of a replay: its tape
  Channel::Counters counters = {};     // of all its lines, those that have ended too
  std::vector<LineStatus> lines = {};  // none while it is in trouble
  std::string why = {};                // of that
  std::optional<Nanos> retry_in = {};
  std::optional<int> ended = {};  // with this exit status
  std::optional<LastTrouble::Told> trouble = {};
};
// As it is configured, without any line.
ChannelStatus described(const ChannelSpec& spec);

JsonObject to_json(const std::string& name, const ChannelStatus& status);

}  // namespace porttape
