#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

#include "daemon/control_protocol.hpp"

namespace porttape::test {

// Notes what a control socket asks for.
class ToldTarget final : public ControlTarget {
 public:
  [[nodiscard]] std::string status() const override {
    if (on_status) on_status();
    return state;
  }
  Result<Outcome> record(const std::string& channel, const RecorderRequest& what) override {
    calls += "mark(" + channel + "," + std::get<line::Mark>(what.note.value()).text + ") ";
    if (error) return *error;
    return Outcome{{channel.empty() ? "all" : channel}, {}};
  }
  Result<Outcome> play(const std::string& channel, const PlaybackRequest& what) override {
    constexpr const char* kNames[] = {"pause", "resume", "step", "seek", "rate"};
    calls += kNames[static_cast<std::size_t>(what.kind)];
    calls += "(" + channel + "," + std::to_string(what.exchanges) + "," + std::to_string(what.to.count()) +
             "," + std::to_string(what.rate) + ") ";
    if (error) return *error;
    return Outcome{{channel.empty() ? "all" : channel}, {}};
  }
  Result<Outcome> stop(const std::string& channel) override {
    calls += "stop(" + channel + ") ";
    if (error) return *error;
    return Outcome{{channel.empty() ? "all" : channel}, {{"other", "no"}}};
  }

  std::string calls;
  std::string state = R"({"pid":7})";
  std::optional<Error> error;
  std::function<void()> on_status;
};

}  // namespace porttape::test
