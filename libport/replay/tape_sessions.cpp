#include "libport/replay/tape_sessions.hpp"

#include "libport/replay/timeline.hpp"

namespace porttape {
namespace {

bool ends_a_direction(RecordKind kind) {
  return kind == RecordKind::hang_up || kind == RecordKind::half_close;
}

}  // namespace

std::optional<TapeTime> TapeSessions::pass_to(TapeTime at) {
  while (!schedule_.at_end() && schedule_.head()->at < at) {
    if (budget_.spent()) return std::nullopt;
    schedule_.skip();
  }
  if (schedule_.opens_passed() > 0 && !schedule_.line_closed()) return at;
  while (!schedule_.at_end() && is_note(schedule_.head()->kind)) {
    if (budget_.spent()) return std::nullopt;
    schedule_.pop();
  }
  if (schedule_.at_end() || schedule_.head()->kind != RecordKind::open) return at;
  const TapeTime opened = schedule_.head()->at;
  schedule_.pop();
  return opened;
}

std::optional<TapeTime> TapeSessions::pass_to_next(TapeTime otherwise) {
  TapeTime opened = otherwise;
  for (bool found = false; !found && !schedule_.at_end();) {
    if (budget_.spent()) return std::nullopt;
    found = schedule_.head()->kind == RecordKind::open;
    if (found) opened = schedule_.head()->at;
    schedule_.pop();
  }
  return opened;
}

bool TapeSessions::open_ahead() {
  if (schedule_.at_end()) return false;
  return schedule_.opens_passed() < opens_ || schedule_.head()->kind == RecordKind::open;
}

std::optional<bool> TapeSessions::nothing_left() {
  while (!schedule_.at_end()) {
    const RecordKind kind = schedule_.head()->kind;
    if (!is_note(kind) && kind != RecordKind::close && !ends_a_direction(kind)) return false;
    if (budget_.spent()) return std::nullopt;
    schedule_.pop();
  }
  if (schedule_.error()) return false;
  const bool asked = gate_.asked();
  if (!asked || gate_.lenient()) return asked;
  return matcher_.at_end();
}

std::optional<bool> TapeSessions::at_recorded_reopen() {
  while (!schedule_.at_end() &&
         (is_note(schedule_.head()->kind) || ends_a_direction(schedule_.head()->kind))) {
    if (budget_.spent()) return std::nullopt;
    schedule_.pop();
  }
  if (schedule_.at_end()) return false;
  const RecordKind kind = schedule_.head()->kind;
  if (kind != RecordKind::open && kind != RecordKind::close) return false;
  return gate_.asked();
}

std::optional<bool> TapeSessions::session_played() {
  const std::optional<bool> nothing = nothing_left();
  if (!nothing || *nothing) return nothing;
  return at_recorded_reopen();
}

std::optional<bool> TapeSessions::line_may_end() {
  while (!schedule_.at_end() && is_note(schedule_.head()->kind)) {
    if (budget_.spent()) return std::nullopt;
    schedule_.pop();
  }
  if (schedule_.at_end()) return nothing_left();
  const RecordKind kind = schedule_.head()->kind;
  const bool at_an_end = ends_a_direction(kind) || kind == RecordKind::open || kind == RecordKind::close;
  return at_an_end && gate_.asked();
}

std::optional<bool> TapeSessions::just_passed_open(Instant now) {
  if (!passed_open_ || now > saturating_add(passed_open_->when, patience_)) return false;
  if (matcher_.touched(passed_open_->writes_end)) return false;
  const std::optional<bool> nothing = nothing_left();
  if (!nothing) return nothing;
  return !*nothing;
}

}  // namespace porttape
