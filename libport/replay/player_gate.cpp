// What the Player waits for: gates, recorded reopens, and the time a write is held against.

#include <algorithm>
#include <chrono>

#include "libport/replay/player.hpp"

namespace porttape {

// Whether the question before the head has been asked. `next_at`: the recorded time of what waits behind it.
bool Player::gate_opens(Instant now, TapeTime next_at) {
  if (!gate_.pending && !gate_.gap) return true;
  if (const auto done = gate_.pending ? matcher_.completion(gate_.end) : std::nullopt) {
    open_gate(gate_.at, done->real, done->real);
    return true;
  }
  if (const auto come = gate_.pending ? matcher_.take(gate_.end) : std::nullopt) {
    open_gate(gate_.at, *come, *come);
    return true;
  }
  if (!silence_counts() && !in_gap()) return wait_for_driver();
  const Silence silence = next_silence(next_at);
  if (now < silence.end) {
    wake_ = silence.end;
    return false;
  }
  // In a gap the place is still to be found: nothing of the tape counts as asked.
  if (!gate_.gap && !matcher_.astray()) matcher_.realign(gate_.end);
  if (silence.after_writing) {
    open_gate(gate_.at, matcher_.last_write(), silence.end);
  } else {
    open_gate(next_at, silence.end, silence.end);
  }
  return true;
}

// `tape` happened at `real`: what follows is timed from there, and nothing of it comes before `not_before`.
void Player::open_gate(TapeTime tape, Instant real, Instant not_before) {
  timeline_.anchor(tape, real);
  last_event_ = {tape, real};
  floor_ = std::max(floor_, not_before);
  gate_.pending = false;
  gate_.gap = false;
  gate_.begin = gate_.end;
}

bool Player::wait_for_driver() {
  wake_.reset();
  return false;
}

// The silence that opens a gate: after the driver has written something, or since the block behind the gate
// was due.
Player::Silence Player::next_silence(TapeTime next_at) const {
  const Instant patience = patience_end(next_at);
  if (matcher_.touched(gate_.begin) || matcher_.astray()) {
    const Instant quiet = saturating_add(matcher_.last_write(), config_.quiet);
    if (quiet <= patience) return {quiet, true};
  }
  return {patience, false};
}

// The driver gets its patience in full: from when the block was due, but not before it really had what came
// before.
Instant Player::patience_end(TapeTime next_at) const {
  const Instant due = std::max({floor_, timeline_.real(next_at), last_event_.real, lenient_since_});
  return saturating_add(due, config_.patience);
}

void Player::become_lenient(Instant now) {
  if (lenient_) return;
  lenient_ = true;
  lenient_since_ = now;
}

std::optional<Player::TimingFault> Player::check_recorded(const Matcher::Step& step, Instant now) const {
  if (gated() || !checks_time()) return std::nullopt;
  return compare_time({matcher_.position(), matcher_.written(), now}, step.at, timeline_.real(step.at));
}

std::optional<Player::TimingFault> Player::compare_time(const Matcher::Completion& done, TapeTime at,
                                                        Instant expected) const {
  const Nanos error = done.real - expected;
  const Nanos margin = config_.jitter;
  if ((error <= margin || config_.late_allowed) && error >= -margin) return std::nullopt;
  TimingFault fault;
  fault.driver_offset = done.driver_end - std::min<std::uint64_t>(done.driver_end, 1);
  fault.tape_offset = done.tape_end - std::min<std::uint64_t>(done.tape_end, 1);
  fault.at = at;
  fault.real = done.real;
  fault.error = std::chrono::round<Micros>(error);
  return fault;
}

}  // namespace porttape
