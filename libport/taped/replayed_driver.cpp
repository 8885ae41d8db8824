#include "libport/taped/replayed_driver.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {

ReplayedDriver::ReplayedDriver(const PortContext& context, ReplayOptions options)
    : ReplayPort(context, std::move(options)), silence_timer_(*context.loop, [this] { end_silence(); }) {}

PortTraits ReplayedDriver::traits() const {
  return {.passive = true, .keeps_datagrams = prepared() && sources().datagrams, .has_half_close = true};
}

std::optional<LineSettings> ReplayedDriver::settings() const {
  return prepared() ? sources().settings : std::nullopt;
}

void ReplayedDriver::open() {
  begin_session();
  open_line();
}

void ReplayedDriver::close() { end_session(); }

void ReplayedDriver::write(ByteView data) {
  last_heard_ = now();
  ReplayPort::write(data);
}

bool ReplayedDriver::end_writing() { return engine()->line_may_end() != false && ReplayPort::end_writing(); }

void ReplayedDriver::set_reading(bool on) {
  last_heard_ = now();
  blocked_ = !on;
  if (on && std::exchange(coming_up_, false)) begin_run(last_heard_);
  ReplayPort::set_reading(on);
}

// Once: the line is there for as long as the tape goes on.
void ReplayedDriver::open_line() {
  last_heard_ = now();
  line_open_ = coming_up_ = blocked_ = true;
  const bool sets = sources().settings && !options().keeps_line;
  if (sets) listener().told(line::Settings{SeenSettings::of(*sources().settings)});
  listener().on_up();
  watch_silence();
}

void ReplayedDriver::close_line(LineDown::Reason reason) {
  if (!std::exchange(line_open_, false)) return;
  coming_up_ = false;
  listener().on_down({.reason = reason, .error = {}});
}

void ReplayedDriver::step_line(const LineStep& step) {
  switch (step.kind) {
    case LineStep::Kind::open:
      return open_line();
    case LineStep::Kind::close:
      return close_line(LineDown::Reason::closed);
    case LineStep::Kind::event:
      return listener().told(*step.event);
  }
}

void ReplayedDriver::hang_up(bool) {
  if (!line_open_) return;
  close_line(LineDown::Reason::hung_up);
  ended_because_ = "the device ended the line, and the tape goes on";
  engine()->on_line_ended(now());
  pump();
  ended_because_.clear();
}

// While nothing goes on by itself, the device is waited for.
void ReplayedDriver::watch_silence() {
  const bool waits_for_line = coming_up_ && !options().waits_for_line;
  const bool waits = waits_for_line || (notes().begun() && !coming_up_ && !engine()->next_deadline());
  if (!options().silence || !waits || finishing()) return silence_timer_.cancel();
  const auto unsent = coming_up_ ? std::nullopt : engine()->first_unsent();
  const Instant since = unsent ? std::max(last_heard_, unsent->due) : last_heard_;
  silence_timer_.set(since + *options().silence);
}

void ReplayedDriver::end_silence() {
  const double limit = std::chrono::duration<double>(*options().silence).count();
  if (coming_up_) {
    context().log->error("the device's line did not come up within {:g} s", limit);
    close_line(LineDown::Reason::closed);
    return listener().on_finished(exit_status::kDevice);
  }
  ended_because_ = blocked_ ? fmt::format("the device's line took nothing for {:g} s", limit)
                            : fmt::format("the device was silent for {:g} s", limit);
  engine()->finish(now());
  pump();
}

void ReplayedDriver::run_ended(RunReport report) {
  if (report.verdict != Verdict::pass) report.outcome = std::exchange(ended_because_, {});
  hand_on(std::move(report));
  close_line(LineDown::Reason::closed);
  ask_for_end();
}

}  // namespace porttape
