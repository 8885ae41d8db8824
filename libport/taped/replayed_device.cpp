#include "libport/taped/replayed_device.hpp"

#include <chrono>
#include <fmt/format.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/replay/seconds_text.hpp"

namespace porttape {

ReplayedDevice::ReplayedDevice(const PortContext& context, ReplayOptions options)
    : ReplayPort(context, std::move(options)), drain_timer_(*context.loop, [this] { end_drains(); }) {}

ReplayedDevice::~ReplayedDevice() = default;

Result<void> ReplayedDevice::prepare() {
  if (Result<void> prepared = ReplayPort::prepare(); !prepared) return prepared;
  settings_ = sources().settings;
  return {};
}

PortTraits ReplayedDevice::traits() const {
  return {.keeps_datagrams = prepared() && sources().datagrams, .has_half_close = true};
}

void ReplayedDevice::open() {
  hand_on_held();
  begin_session();
  begin_run(now());
  listener().on_up();
  pump();
}

void ReplayedDevice::close() {
  if (!is_open()) return;
  end_session();
  settings_ = sources().settings;
  end_drains();
  if (aftermath_) aftermath_->finish();
  notes().close();
  hand_on_held();
  engine()->on_close(now());
  pump();
}

void ReplayedDevice::write(ByteView data) {
  if (aftermath_) aftermath_->write(data);
  ReplayPort::write(data);
}

std::size_t ReplayedDevice::write_some(ByteView data) {
  write(data);
  return data.size();
}

bool ReplayedDevice::discard() {
  if (options().config.timing == Timing::recorded || !prepared() || !sources().schedule->has_events())
    return false;
  drop_due();
  return true;
}

std::string ReplayedDevice::awaits() {
  const auto unsent = prepared() ? engine()->first_unsent() : std::nullopt;
  if (!unsent) return {};
  return fmt::format("the tape goes on after a write of \"{}\" (offset {}, recorded at {:.6f} s)",
                     to_printable(unsent->bytes), unsent->offset, seconds_of(unsent->at));
}

Result<void> ReplayedDevice::apply(const LineSettings& settings) {
  if (!settings_) return Port::apply(settings);
  const std::optional<SeenSettings> answer = sources().line.taken_for(settings);
  if (answer && answer->over(*settings_) == *settings_) {
    return make_error(Errc::usage, fmt::format("{}: on the tape the device did not take {}", name(),
                                               to_text(SeenSettings::of(settings))));
  }
  settings_ = answer ? answer->over(settings) : settings;
  if (settings_ != settings) listener().told(line::Settings{SeenSettings::of(*settings_)});
  return {};
}

void ReplayedDevice::tell(const LineEvent& event) {
  if (const auto* drain = std::get_if<line::Drain>(&event)) return begin_drain(drain->number);
  ReplayPort::tell(event);
}

void ReplayedDevice::begin_drain(RequestNumber number) {
  const std::vector<Micros>& recorded = sources().line.drains();
  const std::size_t index = drains_begun_++;
  if (index >= recorded.size() || options().config.timing == Timing::none)
    return listener().told(line::Sent{number});
  const std::chrono::duration<double, std::micro> lasts = recorded[index] / options().config.rate;
  drains_.push_back(number);
  drain_timer_.set_after(std::chrono::duration_cast<Nanos>(lasts));
}

void ReplayedDevice::end_drains() {
  drain_timer_.cancel();
  for (const RequestNumber number : std::exchange(drains_, {})) listener().told(line::Sent{number});
}

std::string ReplayedDevice::why_in_order() const {
  return sources().index ? "the tape's requests are looked up, whose order is the driver's" : "";
}

// At the tape's end and where it hangs up, the driver reads what is left first; at a mismatch that fails the
// run the line breaks where it stands.
void ReplayedDevice::break_line(ReplayActions& actions) {
  const bool failed = options().config.on_mismatch == OnMismatch::fail &&
                      (!actions.mismatches.empty() || (actions.run_ended && actions.run_ended->mismatch));
  LineDown down{.reason = LineDown::Reason::hung_up, .error = {}, .after_reading = !failed};
  if (failed && !actions.mismatches.empty())
    down.error.message = to_text(actions.mismatches.front(), options().config.writer);
  const bool look_on = options().looks_on && is_open() && failed && actions.run_ended &&
                       actions.run_ended->mismatch &&
                       actions.run_ended->mismatch->kind != MismatchKind::timing;
  if (!look_on) return listener().on_down(down);
  actions.mismatches.clear();
  aftermath_ = std::make_unique<Aftermath>(
      context(), Aftermath::Tape{options().tape, sources().as},
      *std::exchange(actions.run_ended, std::nullopt),
      Aftermath::Calls{.deliver = [this](ByteView answer) { listener().on_data(answer); },
                       .done = [this, down](RunReport report) { end_aftermath(std::move(report), down); }});
}

void ReplayedDevice::end_aftermath(RunReport report, const LineDown& down) {
  reports().look_for_hint(*report.mismatch);
  if (is_open()) listener().on_down(down);
  take_report(std::move(report));
}

void ReplayedDevice::run_ended(RunReport report) {
  drains_begun_ = 0;
  const bool is_end = options().once && !is_look(report);
  const bool waits = is_open() && !report.closed && report.verdict == Verdict::pass && !finishing();
  if (waits) {
    held_ = std::move(report);
  } else {
    hand_on(std::move(report));
  }
  if (is_end) ask_for_end();
}

void ReplayedDevice::hand_on_held() {
  if (held_) hand_on(*std::exchange(held_, std::nullopt));
}

void ReplayedDevice::tape_lost(const std::string& why) {
  listener().on_down({.reason = LineDown::Reason::lost,
                      .error = make_error(Errc::damaged_tape, why),
                      .after_reading = true});
}

void ReplayedDevice::finish() {
  if (aftermath_) aftermath_->finish();
  if (held_ && is_open()) notes().close();
  hand_on_held();
  ReplayPort::finish();
}

}  // namespace porttape
