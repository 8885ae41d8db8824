#include "libport/replay/player.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kShownBytes = 32;

}  // namespace

Player::Player(const ReplayConfig& config, const Engine::TapeFacts& facts, const ClockPlace& place,
               bool half_closes, RecordSource& schedule, Budget& budget, Matcher& matcher)
    : config_(config),
      half_closes_(half_closes),
      budget_(budget),
      matcher_(matcher),
      schedule_(schedule, budget),
      arrivals_(
          config.chunks == Chunks::burst || (config.chunks == Chunks::automatic && !facts.stamped_at_arrival),
          config.burst_gap),
      pace_(place, config.timing),
      gate_(config, matcher, pace_),
      sessions_(schedule_, gate_, matcher, budget, facts.opens, config.patience) {}

void Player::begin(Instant now) {
  schedule_.rewind();
  arrivals_.rewind();
  gate_.begin_run();
  sessions_.forget_passed_open();
  missed_half_close_.reset();
  untimed_ = false;
  gaps_reached_ = 0;
  used_up_ = false;
  seek_ = {Seek::To::start, now};
}

void Player::start_at(TapeTime tape, Instant now) {
  pace_.begin_session(tape, now);
  gaps_reached_ = schedule_.gaps_passed();
  session_start_ = tape;
  wake_ = now;
  matcher_.answered();
}

void Player::continue_at_next_open(Instant now) { seek_ = {Seek::To::next_open, now}; }

void Player::restart_session(Instant now) {
  sessions_.forget_passed_open();
  start_at(session_start_, now);
}

void Player::resume(Instant now) { seek_ = {Seek::To::reopen_if_near, now}; }

bool Player::seek() {
  if (seek_.to == Seek::To::reopen_if_near) {
    const std::optional<bool> near = sessions_.at_recorded_reopen();
    if (!near) return false;
    seek_.to = *near ? Seek::To::next_open : Seek::To::there;
    if (!*near) {
      matcher_.answered();
      wake_ = seek_.since;
    }
  }
  if (seek_.to != Seek::To::there) {
    const std::optional<TapeTime> begin =
        seek_.to == Seek::To::start ? sessions_.pass_to_first() : sessions_.pass_to_next(session_start_);
    if (!begin) return false;
    gate_.begin_session(schedule_.passed().writes);
    sessions_.forget_passed_open();
    start_at(*begin, seek_.since);
  }
  seek_ = {};
  return true;
}

std::optional<Player::TimingFault> Player::play(Instant now, std::size_t max_bytes, bool blocked,
                                                ReplayActions& out) {
  Turn turn{now, Mode::deliver, blocked, max_bytes, &out};
  if (out.deliver.empty()) delivered_due_.reset();
  for (bool go_on = true; go_on;) {
    const std::size_t held = out.deliver.size();
    turn.room = max_bytes - std::min(max_bytes, held);
    const Progress progress = step(turn);
    if (progress == Progress::waits) return std::nullopt;
    if (progress == Progress::fault) return std::exchange(fault_, std::nullopt);
    go_on = out.deliver.size() > held || !budget_.spent();
  }
  wake_ = now;
  return std::nullopt;
}

Player::Progress Player::step(Turn& turn) {
  const Record* head = schedule_.head();
  if (head == nullptr) return at_end(turn);
  switch (head->kind) {
    case RecordKind::read:
      return at_read(turn);
    case RecordKind::write:
      return at_write(turn);
    case RecordKind::open:
      return at_open(turn);
    case RecordKind::close:
      return at_close(turn);
    case RecordKind::hang_up:
      return at_device_end(turn, &ReplayActions::hang_up);
    case RecordKind::half_close:
      return at_half_close(turn);
    case RecordKind::gap:
      return at_gap();
    case RecordKind::event:
      break;
  }
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::wait(std::optional<Instant> until) {
  wake_ = until;
  return Progress::waits;
}

bool Player::gate_opens(Instant now, TapeTime next_at) {
  const Gate::Answer answer = gate_.open(now, next_at);
  if (!answer.open) wake_ = answer.until;
  return answer.open;
}

Player::Progress Player::at_read(Turn& turn) {
  const Record& head = *schedule_.head();
  if (head.data.empty() || schedule_.line_closed()) {
    schedule_.pop();
    return Progress::passed;
  }
  if (!gate_opens(turn.now, head.at)) return Progress::waits;
  arrivals_.look(head, schedule_);
  const Instant when = pace_.due(arrivals_.first());
  if (turn.mode == Mode::drop_all || (turn.mode != Mode::deliver && when <= turn.now)) {
    pace_.played(head.at, when, when);
    schedule_.pop();
    return Progress::passed;
  }
  if (turn.now < when && !turn.blocked) return wait(when);
  if (turn.blocked) return wait(std::nullopt);
  // A block is cut only where it does not fit a delivery of its own: it may be a datagram.
  const bool cut = turn.room < schedule_.rest().size() && !turn.out->deliver.empty();
  if (turn.room == 0 || cut) return wait(turn.now);
  deliver(turn, when);
  return Progress::passed;
}

void Player::deliver(Turn& turn, Instant when) {
  ReplayActions& out = *turn.out;
  const ByteView rest = schedule_.rest();
  const ByteView part = rest.first(std::min(rest.size(), turn.room));
  out.deliver.insert(out.deliver.end(), part.begin(), part.end());
  if (arrivals_.continues() && !out.block_ends.empty()) {
    out.block_ends.back() = out.deliver.size();
  } else {
    out.block_ends.push_back(out.deliver.size());
  }
  if (!delivered_due_) delivered_due_ = when;
  pace_.played(schedule_.head()->at, when, turn.now);
  untimed_ = false;
  matcher_.answered();
  gaps_reached_ = schedule_.gaps_passed();
  schedule_.take(part.size());
  if (part.size() == rest.size()) {
    schedule_.pop();
  } else {
    arrivals_.delivered_part();
  }
}

// Of its line or of its sending: due as a read would be.
Player::Progress Player::at_device_end(Turn& turn, bool ReplayActions::*what) {
  const TapeTime at = schedule_.head()->at;
  if (!schedule_.line_closed()) {
    if (!gate_opens(turn.now, at)) return Progress::waits;
    const Instant when = pace_.due(at);
    const bool dropped = turn.mode == Mode::drop_all || (turn.mode == Mode::drop_due && when <= turn.now);
    if (!dropped) {
      if (turn.blocked) return wait(std::nullopt);
      if (turn.mode != Mode::deliver || turn.now < when) return wait(when);
      turn.out->*what = true;
    }
    pace_.played(at, when, dropped ? when : turn.now);
  }
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_half_close(Turn& turn) {
  const auto* half_close = std::get_if<event::HalfClose>(schedule_.head()->event);
  const bool by_device = half_close != nullptr && half_close->by == Side::device;
  return by_device ? at_device_end(turn, &ReplayActions::end_sending) : at_driver_end(turn);
}

// One that comes late has come.
void Player::set_writing_ended(std::optional<Instant> since) {
  writing_ended_ = since;
  if (since && missed_half_close_ && *missed_half_close_ >= session_start_) missed_half_close_.reset();
}

// A gate like a write: what follows is timed from the driver's own end of writing, which a close is too. One
// that never comes is waited for with patience.
Player::Progress Player::at_driver_end(const Turn& turn) {
  const TapeTime at = schedule_.head()->at;
  if (half_closes_ && !schedule_.line_closed()) {
    const Instant when = timeline().real(at);
    if (turn.mode == Mode::flush) return wait(std::nullopt);
    if (!gated() && turn.mode == Mode::deliver && turn.now < when) return wait(when);
    if (gated() && turn.mode == Mode::deliver) {
      if (!gate_opens(turn.now, at)) return Progress::waits;
      const Instant patience = gate_.patience_end(at);
      if (!writing_ended_ && turn.now < patience) return wait(patience);
      if (!writing_ended_ && !missed_half_close_) missed_half_close_ = at;
      const Instant since = writing_ended_.value_or(patience);
      pace_.go_on_from(at, since, since);
    }
  }
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_write(const Turn& turn) {
  const Record& head = *schedule_.head();
  const std::uint64_t end = schedule_.passed().writes + head.data.size();
  if (gated() && !head.data.empty()) {
    if (checks_time() && matcher_.comparing() && !gate_.pending()) return at_timed_write(turn);
    gate_.add_write(end, head.at);
  }
  // By the recorded clock a write holds nothing up; the walk only keeps to its time.
  const Instant when = timeline().real(head.at);
  if (!gated() && turn.mode == Mode::deliver && turn.now < when) return wait(when);
  schedule_.pop();
  return Progress::passed;
}

// Strictness 2: every write record is a gate of its own, since the next write is measured from it.
Player::Progress Player::at_timed_write(const Turn& turn) {
  const Record head = *schedule_.head();
  const std::uint64_t end = schedule_.passed().writes + head.data.size();
  const auto done = matcher_.completion(end);
  if (!done) {
    if (!gate_.silence_counts() || turn.mode != Mode::deliver) return wait(std::nullopt);
    const Gate::Silence silence = gate_.next_silence(head.at);
    if (turn.now < silence.end) return wait(silence.end);
    matcher_.diverge();
    return Progress::passed;
  }
  if (!head.last_piece()) {
    schedule_.pop();
    return Progress::passed;
  }
  if (!std::exchange(untimed_, false)) {
    fault_ = compare_time(*done, head.at, pace_.after_last(head.at), head.data);
  }
  gate_.pass(end, head.at, done->real);
  schedule_.pop();
  return fault_ ? Progress::fault : Progress::passed;
}

Player::Progress Player::at_gap() {
  const auto* gap = std::get_if<event::Gap>(schedule_.head()->event);
  if (gap != nullptr && gap->bytes > 0 && gated() && !schedule_.line_closed()) {
    // A device that is never asked goes on by itself.
    gate_.add_gap(schedule_.head()->at, schedule_.passed().writes > 0);
    untimed_ = true;
  }
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_close(const Turn& turn) {
  if (turn.mode != Mode::deliver) return wait(std::nullopt);
  const Instant when = timeline().real(schedule_.head()->at);
  if (!gated() && turn.now < when) return wait(when);
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_open(const Turn& turn) {
  if (turn.mode != Mode::deliver) return wait(std::nullopt);
  const TapeTime at = schedule_.head()->at;
  const Instant when = timeline().real(at);
  if (!gated()) {
    if (turn.now < when) return wait(when);
    sessions_.passed_open(turn.now);
    session_start_ = at;
    schedule_.pop();
    return Progress::passed;
  }
  if (!gate_opens(turn.now, at)) return Progress::waits;
  // A driver that writes what the tape has after the reopen has gone on without one. Bytes that the tape has
  // not (a trailing one, written just before the close) do not tell.
  const bool went_on = matcher_.comparing() && matcher_.touched(schedule_.passed().writes);
  const bool gave_up = gate_.silence_counts() && turn.now >= gate_.patience_end(at);
  if (!went_on && !gave_up)
    return wait(gate_.silence_counts() ? std::optional(gate_.patience_end(at)) : std::nullopt);
  const Instant since = went_on ? matcher_.last_write() : gate_.patience_end(at);
  pace_.go_on_past_open(at, since);
  session_start_ = at;
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_end(const Turn& turn) {
  if (schedule_.error()) return wait(std::nullopt);
  if (!gate_opens(turn.now, gate_.at())) return Progress::waits;
  if (!gate_.lenient()) {
    const std::optional<bool> all_came = matcher_.at_end();
    if (!all_came) return wait(turn.now);
    if (!*all_came) return wait(std::nullopt);
  }
  used_up_ = true;
  gaps_reached_ = schedule_.gaps_passed();
  return wait(std::nullopt);
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

std::optional<Player::TimingFault> Player::check_recorded(const Matcher::Step& step, Instant now) const {
  if (gated() || !checks_time()) return std::nullopt;
  return compare_time({matcher_.position(), matcher_.written(), now}, step.at, timeline().real(step.at),
                      matcher_.latest(step.block_size));
}

std::optional<Player::TimingFault> Player::compare_time(const Matcher::Completion& done, TapeTime at,
                                                        Instant expected, ByteView bytes) const {
  const Nanos error = done.real - expected;
  const Nanos margin = config_.jitter;
  if ((error <= margin || config_.late_allowed) && error >= -margin) return std::nullopt;
  TimingFault fault;
  fault.driver_offset = done.driver_end - std::min<std::uint64_t>(done.driver_end, 1);
  fault.tape_offset = done.tape_end - std::min<std::uint64_t>(done.tape_end, 1);
  fault.at = at;
  fault.real = done.real;
  fault.error = std::chrono::round<Micros>(error);
  const ByteView shown = bytes.first(std::min(bytes.size(), kShownBytes));
  fault.bytes.assign(shown.begin(), shown.end());
  return fault;
}

}  // namespace porttape
