#include "libport/replay/player.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

// A burst is cut here, so that a stream of single bytes without a pause still plays in time.
constexpr Micros kLongestBurst{100'000};

}  // namespace

Player::Player(const ReplayConfig& config, const Engine::TapeFacts& facts, RecordSource& schedule,
               Budget& budget, Matcher& matcher)
    : config_(config),
      facts_(facts),
      burst_(config.chunks == Chunks::burst ||
             (config.chunks == Chunks::automatic && !facts.stamped_at_arrival)),
      budget_(budget),
      matcher_(matcher),
      schedule_(schedule, budget),
      timeline_(config.rate) {}

void Player::begin(Instant now) {
  schedule_.rewind();
  gate_ = {};
  untimed_ = false;
  gaps_reached_ = 0;
  passed_open_.reset();
  arrival_known_ = false;
  arrival_started_ = false;
  lenient_ = config_.strictness == 0;
  used_up_ = false;
  seek_ = {Seek::To::start, now};
}

void Player::start_at(TapeTime tape, Instant now) {
  timeline_.anchor(tape, now);
  gaps_reached_ = schedule_.gaps_passed();
  session_start_ = tape;
  last_event_ = {tape, now};
  floor_ = now;
  wake_ = now;
  matcher_.answered();
}

void Player::continue_at_next_open(Instant now) { seek_ = {Seek::To::next_open, now}; }

void Player::restart_session(Instant now) {
  passed_open_.reset();
  start_at(session_start_, now);
}

void Player::resume(Instant now) { seek_ = {Seek::To::reopen_if_near, now}; }

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
      return at_hang_up(turn);
    case RecordKind::gap:
      return at_gap();
    case RecordKind::event:
      break;
  }
  pass();
  return Progress::passed;
}

// Leaves the head behind. A write, open or close ends an arrival.
void Player::pass() {
  const Record* head = schedule_.head();
  if (head != nullptr && head->kind != RecordKind::read && !is_note(head->kind) && !head->data.empty()) {
    arrival_started_ = false;
  }
  if (head != nullptr && (head->kind == RecordKind::open || head->kind == RecordKind::close ||
                          head->kind == RecordKind::hang_up)) {
    arrival_started_ = false;
  }
  schedule_.pop();
  arrival_known_ = false;
}

Player::Progress Player::wait(std::optional<Instant> until) {
  wake_ = until;
  return Progress::waits;
}

// Works out which arrival the read at the head belongs to.
void Player::begin_arrival() {
  if (arrival_known_) return;
  arrival_known_ = true;
  const Record& head = *schedule_.head();
  const bool joins = burst_ && arrival_started_ && head.at - arrival_last_ < config_.burst_gap &&
                     head.at - arrival_first_ < kLongestBurst;
  arrival_continues_ = joins || (arrival_started_ && head.piece_offset > 0);
  if (!arrival_continues_) arrival_first_ = head.at;
  arrival_last_ = head.at;
  arrival_started_ = true;
}

Instant Player::due(TapeTime at) const {
  return config_.timing == Timing::none ? floor_ : std::max(floor_, timeline_.real(at));
}

Player::Progress Player::at_read(Turn& turn) {
  const Record& head = *schedule_.head();
  if (head.data.empty() || schedule_.line_closed()) {
    pass();
    return Progress::passed;
  }
  if (!gate_opens(turn.now, head.at)) return Progress::waits;
  begin_arrival();
  const Instant when = due(arrival_first_);
  if (turn.mode == Mode::drop_all || (turn.mode != Mode::deliver && when <= turn.now)) {
    floor_ = when;
    last_event_ = {head.at, when};
    pass();
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
  if (arrival_continues_ && !out.block_ends.empty()) {
    out.block_ends.back() = out.deliver.size();
  } else {
    out.block_ends.push_back(out.deliver.size());
  }
  if (!delivered_due_) delivered_due_ = when;
  floor_ = when;
  last_event_ = {schedule_.head()->at, turn.now};
  untimed_ = false;
  matcher_.answered();
  gaps_reached_ = schedule_.gaps_passed();
  arrival_continues_ = true;
  schedule_.take(part.size());
  if (part.size() == rest.size()) pass();
}

// Due as a read would be.
Player::Progress Player::at_hang_up(Turn& turn) {
  const TapeTime at = schedule_.head()->at;
  if (!schedule_.line_closed()) {
    if (!gate_opens(turn.now, at)) return Progress::waits;
    const Instant when = due(at);
    const bool dropped = turn.mode == Mode::drop_all || (turn.mode == Mode::drop_due && when <= turn.now);
    if (!dropped) {
      if (turn.blocked) return wait(std::nullopt);
      if (turn.mode != Mode::deliver || turn.now < when) return wait(when);
      turn.out->hang_up = true;
    }
    floor_ = when;
    last_event_ = {at, dropped ? when : turn.now};
  }
  pass();
  return Progress::passed;
}

Player::Progress Player::at_write(const Turn& turn) {
  const Record& head = *schedule_.head();
  const std::uint64_t end = schedule_.passed().writes + head.data.size();
  if (gated() && !head.data.empty()) {
    if (checks_time() && matcher_.comparing() && !gate_.pending) return at_timed_write(turn);
    gate_.pending = true;
    gate_.end = end;
    gate_.at = head.at;
  }
  // By the recorded clock a write holds nothing up; the walk only keeps to its time.
  const Instant when = timeline_.real(head.at);
  if (!gated() && turn.mode == Mode::deliver && turn.now < when) return wait(when);
  pass();
  return Progress::passed;
}

// Strictness 2: every write record is a gate of its own, since the next write is measured from it.
Player::Progress Player::at_timed_write(const Turn& turn) {
  const Record head = *schedule_.head();
  const std::uint64_t end = schedule_.passed().writes + head.data.size();
  const auto done = matcher_.completion(end);
  if (!done) {
    if (!silence_counts() || turn.mode != Mode::deliver) return wait(std::nullopt);
    const Silence silence = next_silence(head.at);
    if (turn.now < silence.end) return wait(silence.end);
    matcher_.diverge();
    return Progress::passed;
  }
  if (!head.last_piece()) {
    pass();
    return Progress::passed;
  }
  if (!std::exchange(untimed_, false)) {
    fault_ = compare_time(*done, head.at, timeline_.after(last_event_.real, head.at - last_event_.tape));
  }
  gate_.end = end;
  open_gate(head.at, done->real, done->real);
  pass();
  return fault_ ? Progress::fault : Progress::passed;
}

Player::Progress Player::at_gap() {
  const auto* gap = std::get_if<event::Gap>(schedule_.head()->event);
  if (gap != nullptr && gap->bytes > 0 && gated() && !schedule_.line_closed()) {
    gate_.gap = schedule_.passed().writes > 0;  // a device that is never asked goes on by itself
    if (!gate_.pending) gate_.at = schedule_.head()->at;
    untimed_ = true;
  }
  pass();
  return Progress::passed;
}

Player::Progress Player::at_close(const Turn& turn) {
  if (turn.mode != Mode::deliver) return wait(std::nullopt);
  const Instant when = timeline_.real(schedule_.head()->at);
  if (!gated() && turn.now < when) return wait(when);
  pass();
  return Progress::passed;
}

Player::Progress Player::at_open(const Turn& turn) {
  if (turn.mode != Mode::deliver) return wait(std::nullopt);
  const TapeTime at = schedule_.head()->at;
  const Instant when = timeline_.real(at);
  if (!gated()) {
    if (turn.now < when) return wait(when);
    passed_open_ = {turn.now, schedule_.passed().writes};
    session_start_ = at;
    pass();
    return Progress::passed;
  }
  if (!gate_opens(turn.now, at)) return Progress::waits;
  // A driver that writes what the tape has after the reopen has gone on without one. Bytes that the tape has
  // not (a trailing one, written just before the close) do not tell.
  const bool went_on = matcher_.comparing() && matcher_.touched(schedule_.passed().writes);
  const bool gave_up = silence_counts() && turn.now >= patience_end(at);
  if (!went_on && !gave_up) return wait(silence_counts() ? std::optional(patience_end(at)) : std::nullopt);
  const Instant since = went_on ? matcher_.last_write() : patience_end(at);
  timeline_.anchor(at, since);
  floor_ = std::max(floor_, since);
  session_start_ = at;
  pass();
  return Progress::passed;
}

Player::Progress Player::at_end(const Turn& turn) {
  if (schedule_.error()) return wait(std::nullopt);
  if (!gate_opens(turn.now, gate_.at)) return Progress::waits;
  if (!lenient_) {
    const std::optional<bool> all_came = matcher_.at_end();
    if (!all_came) return wait(turn.now);
    if (!*all_came) return wait(std::nullopt);
  }
  used_up_ = true;
  gaps_reached_ = schedule_.gaps_passed();
  return wait(std::nullopt);
}

}  // namespace porttape
