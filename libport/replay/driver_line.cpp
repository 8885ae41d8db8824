#include "libport/replay/driver_line.hpp"

#include <algorithm>
#include <variant>

namespace porttape {

void DriverLine::pass_answer(TapeTime at) {
  if (latest_) pause_ = std::max(pause_, at - *latest_);
  latest_ = at;
}

DriverLine::Answer DriverLine::wait_until_due(Instant now, TapeTime at) {
  const Gate::Answer gate = gate_.open(now, at);
  if (!gate.open) return {.until = gate.until};
  return wait_until(now, pace_.due(at));
}

DriverLine::Answer DriverLine::wait_until(Instant now, Instant due) {
  if (now < due) return {.until = due};
  return {.done = true};
}

DriverLine::Answer DriverLine::at_open(Instant now, std::optional<LineStep>& step) {
  const TapeTime at = schedule_.head()->at;
  if (opening_) return {};
  if (open_) return {.done = true};  // the tape has no close before it
  if (const Answer due = wait_until_due(now, at); !due.done) return due;
  opening_ = true;
  step = LineStep{.kind = LineStep::Kind::open};
  return {};
}

DriverLine::Answer DriverLine::at_close(Instant now, std::optional<LineStep>& step) {
  const TapeTime at = schedule_.head()->at;
  const Gate::Answer gate = gate_.open(now, at);
  if (!gate.open) return {.until = gate.until};
  const Instant heard = sessions_.open_ahead() ? now : heard_out(now, at);
  if (const Answer due = wait_until(now, std::max(pace_.due(at), heard)); !due.done) return due;
  pace_.played(at, now, now);
  if (open_) step = LineStep{.kind = LineStep::Kind::close};
  open_ = false;
  return {.done = true};
}

DriverLine::Answer DriverLine::at_event(Instant now, std::optional<LineStep>& step) {
  const Record& head = *schedule_.head();
  auto taped = head.event == nullptr ? std::nullopt : line_event_of(*head.event);
  // The tape is swapped: what its driver did is the device's there, but for flushes, which have no side.
  const bool its = taped && (taped->by == Side::device || std::holds_alternative<line::Flush>(taped->what));
  if (!its || !open_) return {.done = true};
  if (const Answer due = wait_until_due(now, head.at); !due.done) return due;
  pace_.played(head.at, pace_.due(head.at), now);
  // Here it is made, however its moment was seen then.
  if (auto* settings = std::get_if<line::Settings>(&taped->what)) settings->order = SettingsOrder::exact;
  step = LineStep{.kind = LineStep::Kind::event, .event = taped->what};
  return {.done = true};
}

DriverLine::Answer DriverLine::at_end(Instant now) {
  return wait_until(now, heard_out(now, latest_.value_or(TapeTime{})));
}

// When what the tape has nothing of has had its time to come, since all had come that it has.
Instant DriverLine::heard_out(Instant now, TapeTime at) {
  if (!open_ || !lingers_) return now;
  streams_on_ = latest_ && pause_ >= kPause && at - *latest_ < 2 * pause_;
  if (streams_on_) return now;
  if (!all_came_) all_came_ = now;
  return *all_came_ + kLinger;
}

}  // namespace porttape
