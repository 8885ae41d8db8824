#include "daemon/channel_status.hpp"

#include <array>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <string_view>

namespace porttape {
namespace {

std::string_view word_of(Session::State state) {
  constexpr std::array<std::string_view, 7> words = {"waiting", "opening",  "open",  "interrupted",
                                                     "broken",  "draining", "ending"};
  return words.at(static_cast<std::size_t>(state));
}

std::string_view word_of(RecordingStatus::State state) {
  constexpr std::array<std::string_view, 4> words = {"waiting", "recording", "failing", "not-made"};
  return words.at(static_cast<std::size_t>(state));
}

std::string value_of(const ChannelSpec& spec, const std::string& option) {
  const auto given = spec.values.find(option);
  return given == spec.values.end() ? std::string() : given->second;
}

std::optional<double> seconds_of(const std::optional<Micros>& time) {
  return time ? std::optional(static_cast<double>(time->count()) / 1e6) : std::nullopt;
}

JsonObject to_json(const PlaybackStatus& playback) {
  return JsonObject()
      .add_raw("paused", playback.paused ? "true" : "false")
      .add_or_null("position_s", seconds_of(playback.position))
      .add_or_null("length_s", seconds_of(playback.length))
      .add("rate", playback.rate)
      .add("loop", playback.loop)
      .add_or_null("loops", playback.loops);
}

JsonList list_of(const std::vector<LineStatus>& lines) {
  JsonList list;
  for (const LineStatus& line : lines) {
    JsonObject json;
    json.add("state", word_of(line.state))
        .add("driver", line.driver)
        .add_or_null("driver_node", line.driver_node.empty() ? std::nullopt : std::optional(line.driver_node))
        .add("device", line.device);
    if (line.playback) json.add("playback", to_json(*line.playback));
    list.add(json);
  }
  return list;
}

JsonObject to_json(const RecordingStatus& recording) {
  JsonObject json;
  json.add("name", recording.tape)
      .add("state", word_of(recording.state))
      .add("bytes", recording.bytes)
      .add("lost_bytes", recording.lost_bytes)
      .add("queued_bytes", recording.queued_bytes)
      .add("why", recording.why);
  return json;
}

JsonList tapes_of(const std::vector<LineStatus>& lines) {
  JsonList list;
  for (const LineStatus& line : lines) {
    if (line.recording) list.add(to_json(*line.recording));
  }
  return list;
}

// Of all lines the one that a person asks for: that of a channel with one line.
std::string_view state_of(const ChannelStatus& status) {
  if (status.ended) return "ended";
  if (status.lines.empty()) return "retrying";
  for (const LineStatus& line : status.lines) {
    if (line.state != Session::State::waiting) return word_of(line.state);
  }
  return word_of(Session::State::waiting);
}

}  // namespace

std::string wall_text(WallTime time) {
  return fmt::format("{:%FT%TZ}", fmt::gmtime(std::chrono::system_clock::to_time_t(time)));
}

std::optional<LastTrouble::Told> LastTrouble::told() const {
  const std::lock_guard lock(mutex_);
  return told_;
}

void LastTrouble::log(const spdlog::details::log_msg& message) {
  const std::lock_guard lock(mutex_);
  told_ = Told{message.time, std::string(message.payload.data(), message.payload.size())};
}

LineStatus status_of(Session& session) {
  LineStatus line{.state = session.state(),
                  .driver = session.driver().name(),
                  .driver_node = session.driver().place().node,
                  .device = session.device().name(),
                  .recording = {}};
  if (const Recorder* const recorder = session.device().recorder()) line.recording = recorder->recording();
  if (Playback* const tape = session.device().playback_control()) line.playback = tape->playback();
  return line;
}

ChannelStatus described(const ChannelSpec& spec) {
  return {.mode = std::string(to_string(spec.mode)),
          .driver = value_of(spec, "driver"),
          .device = value_of(spec, spec.mode == ChannelMode::replay ? "tape" : "device")};
}

JsonObject to_json(const std::string& name, const ChannelStatus& status) {
  const Channel::Counters& sum = status.counters;
  JsonObject json;
  json.add("name", name)
      .add("mode", status.mode)
      .add("state", state_of(status))
      .add("driver", status.driver)
      .add("device", status.device)
      .add("from_driver_bytes", sum.from_driver_bytes)
      .add("to_driver_bytes", sum.to_driver_bytes)
      .add("dropped_bytes", sum.dropped_bytes)
      .add("opens", sum.opens)
      .add("lines", list_of(status.lines))
      .add("tapes", tapes_of(status.lines));
  if (status.retry_in) {
    json.add("retry_in_s", std::chrono::ceil<std::chrono::seconds>(*status.retry_in).count());
    json.add("why", status.why);
  }
  if (status.ended) json.add("exit_status", *status.ended);
  if (!status.trouble) {
    json.add_raw("last_trouble", "null");
    return json;
  }
  JsonObject trouble;
  trouble.add("at", wall_text(status.trouble->at)).add("text", status.trouble->text);
  json.add("last_trouble", trouble);
  return json;
}

}  // namespace porttape
