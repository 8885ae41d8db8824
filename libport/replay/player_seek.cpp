// Where a session plays from, and what a close means: the Player's walk without playing. Every loop here ends
// when the budget is spent.

#include <utility>

#include "libport/replay/player.hpp"

namespace porttape {

bool Player::seek() {
  if (seek_.to == Seek::To::reopen_if_near) {
    const std::optional<bool> near = at_recorded_reopen();
    if (!near) return false;
    seek_.to = *near ? Seek::To::next_open : Seek::To::there;
    if (!*near) {
      matcher_.answered();
      wake_ = seek_.since;
    }
  }
  const bool there = seek_.to == Seek::To::start       ? seek_start()
                     : seek_.to == Seek::To::next_open ? seek_next_open()
                                                       : true;
  if (there) seek_ = {};
  return there;
}

bool Player::seek_start() {
  while (!schedule_.at_end() && is_note(schedule_.head()->kind)) {
    if (budget_.spent()) return false;
    pass();
  }
  const bool recorded_open = !schedule_.at_end() && schedule_.head()->kind == RecordKind::open;
  const TapeTime start = recorded_open ? schedule_.head()->at : TapeTime{};
  if (recorded_open) pass();
  start_at(start, seek_.since);
  return true;
}

bool Player::seek_next_open() {
  TapeTime opened = session_start_;
  for (bool found = false; !found && !schedule_.at_end();) {
    if (budget_.spent()) return false;
    found = schedule_.head()->kind == RecordKind::open;
    if (found) opened = schedule_.head()->at;
    schedule_.pop();
  }
  arrival_known_ = false;
  arrival_started_ = false;
  gate_ = {false, schedule_.passed().writes, schedule_.passed().writes, TapeTime{}};
  passed_open_.reset();
  start_at(opened, seek_.since);
  return true;
}

Player::Settled Player::settle(Instant now) {
  Turn turn{now, Mode::drop_due, false, 0, nullptr};
  return pass_on(turn, std::nullopt);
}

Player::Settled Player::flush(Instant now) {
  Turn turn{now, Mode::flush, false, 0, nullptr};
  return pass_on(turn, std::nullopt);
}

Player::Settled Player::judge(Instant now) {
  if (!gated() || !checks_time()) return {.done = true};
  Turn turn{now, Mode::drop_all, false, 0, nullptr};
  return pass_on(turn, matcher_.position());
}

// Until something is to be waited for, or so many bytes of writes are passed.
Player::Settled Player::pass_on(Turn& turn, std::optional<std::uint64_t> writes) {
  while (!writes || schedule_.passed().writes < *writes) {
    if (budget_.spent()) return {.done = false};
    const Progress progress = step(turn);
    if (progress == Progress::waits) break;
    if (progress == Progress::fault) return {.done = false, .fault = std::exchange(fault_, std::nullopt)};
  }
  return {.done = true};
}

std::optional<bool> Player::nothing_left() {
  while (!schedule_.at_end()) {
    const RecordKind kind = schedule_.head()->kind;
    if (!is_note(kind) && kind != RecordKind::close && kind != RecordKind::hang_up) return false;
    if (budget_.spent()) return std::nullopt;
    pass();
  }
  if (schedule_.error()) return false;
  const bool asked = !gate_.pending || matcher_.position() >= gate_.end;
  if (!asked || lenient_) return asked;
  return matcher_.at_end();
}

bool Player::open_ahead() {
  if (schedule_.at_end()) return false;
  return schedule_.opens_passed() < facts_.opens || schedule_.head()->kind == RecordKind::open;
}

std::optional<bool> Player::at_recorded_reopen() {
  while (!schedule_.at_end() &&
         (is_note(schedule_.head()->kind) || schedule_.head()->kind == RecordKind::hang_up)) {
    if (budget_.spent()) return std::nullopt;
    pass();
  }
  if (schedule_.at_end()) return false;
  const RecordKind kind = schedule_.head()->kind;
  if (kind != RecordKind::open && kind != RecordKind::close) return false;
  return !gate_.pending || matcher_.position() >= gate_.end;
}

std::optional<bool> Player::session_played() {
  const std::optional<bool> nothing = nothing_left();
  if (!nothing || *nothing) return nothing;
  return at_recorded_reopen();
}

std::optional<bool> Player::just_passed_open(Instant now) {
  if (!passed_open_ || now > saturating_add(passed_open_->when, config_.patience)) return false;
  if (matcher_.touched(passed_open_->writes_end)) return false;
  const std::optional<bool> nothing = nothing_left();
  if (!nothing) return nothing;
  return !*nothing;
}

}  // namespace porttape
