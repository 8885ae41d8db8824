#include "libport/replay/player.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace porttape {
namespace {

// Of a device that speaks without being asked.
constexpr Nanos kShortestLoop = std::chrono::milliseconds(1);
// A device whose line follows the driver's so soon does so at once: a driver may look within its next call.
constexpr Nanos kAtOnce = std::chrono::microseconds(200);

}  // namespace

Player::Player(const ReplayConfig& config, const Engine::TapeFacts& facts, const ClockPlace& place,
               bool half_closes, RecordSource& schedule, Budget& budget, Matcher& matcher,
               SettingsCheck& settings, Pieces& pieces)
    : config_(config),
      half_closes_(half_closes),
      drives_(config.writer == Writer::device),
      budget_(budget),
      matcher_(matcher),
      settings_(settings),
      schedule_(schedule, budget, settings),
      arrivals_(joins_bursts(config.chunks, facts.stamped_at_arrival), config.burst_gap),
      pieces_(pieces),
      pace_(place, config.timing, config.max_gap),
      gate_(config, matcher, pace_),
      sessions_(schedule_, gate_, matcher, budget, facts.opens, config.patience),
      driver_line_(config_, schedule_, gate_, pace_, sessions_),
      loops_(config.loops),
      preroll_from_(config.preroll ? facts.preroll_from : std::nullopt) {}

void Player::begin(Instant now) {
  schedule_.rewind();
  arrivals_.rewind();
  gate_.begin_run();
  sessions_.forget_passed_open();
  driver_line_.begin();
  signals_.forget();
  late_events_.clear();
  missed_half_close_.reset();
  think_times_ = {};
  gaps_reached_ = most_gaps_ = 0;
  doubtful_answers_ = 0;
  loops_.begin_first(now);
  prerolled_ = {};
  pace_.hurry(preroll_from_.has_value());
  handshake_.reset();
  if (preroll_from_) handshake_.emplace(*preroll_from_);
  const TapeTime from = preroll_from_.value_or(config_.start);
  jump(from, now);
  seek_.jumps = false;
  untimed_ = from > TapeTime{};
}

void Player::jump(TapeTime to, Instant now) {
  ++jumps_;
  if (schedule_.passed(to)) {
    most_gaps_ = gaps_reached();
    schedule_.restart();
  }
  matcher_.go_to(to);
  arrivals_.rewind();
  used_up_ = false;
  untimed_ = true;
  fault_.reset();
  seek_ = {Seek::To::time, now, to};
  wake_ = now;
}

// How they stand where the tape is entered in the middle of a session.
void Player::tell_signals() {
  for (const auto& [name, signal] : schedule_.device_signals()) {
    late_events_.put(signal);
    signals_.tell(name);
  }
}

void Player::begin_next_loop(Instant now) {
  loops_.begin_next(now);
  jump(config_.start, now);
  // Its begin is on the tape, unlike a start, which a user puts anywhere.
  untimed_ = config_.start > TapeTime{};
}

void Player::start_at(TapeTime tape, Instant now, Begins begins) {
  think_times_.forget();
  if (begins == Begins::session) {
    pace_.begin_session(tape, now);
  } else {
    pace_.jump(tape, now);
  }
  gaps_reached_ = schedule_.gaps_passed();
  asked_ = schedule_.passed().writes;
  answer_ = LeftOut::no;
  session_start_ = tape;
  signals_.begin_session(now);
  late_events_.clear();
  if (shows_signals_) tell_signals();
  session_bytes_ = schedule_.passed().reads + schedule_.passed().writes;
  wake_ = now;
  pieces_.begin(now);
  matcher_.answered();
}

void Player::continue_at_next_open(Instant now) { seek_ = {Seek::To::next_open, now}; }

void Player::restart_session(Instant now) {
  sessions_.forget_passed_open();
  start_at(session_start_, now, loops_.is_first() ? Begins::session : Begins::elsewhere);
}

void Player::resume(Instant now) { seek_ = {Seek::To::reopen_if_near, now}; }

bool Player::seek() {
  if (seek_.to == Seek::To::there) return true;
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
    const bool to_time = seek_.to == Seek::To::time;
    const std::optional<TapeTime> begin =
        to_time ? sessions_.pass_to(seek_.target) : sessions_.pass_to_next(session_start_);
    if (!begin) return false;
    gate_.begin_session(schedule_.passed().writes);
    sessions_.forget_passed_open();
    if (!to_time) loops_.session_began();
    const bool elsewhere = (to_time && seek_.jumps) || !loops_.is_first();
    start_at(*begin, seek_.since, elsewhere ? Begins::elsewhere : Begins::session);
    if (handshake_) begin_preroll(*begin);
  }
  seek_ = {};
  return true;
}

std::optional<Player::TimingFault> Player::play(Instant now, std::size_t max_bytes, bool blocked,
                                                ReplayActions& out) {
  Turn turn{now, Mode::deliver, blocked, max_bytes, &out};
  if (out.deliver.empty()) delivered_due_.reset();
  holds_piece_ = false;
  for (bool go_on = true; go_on;) {
    if (!seek()) break;
    for (LineEvent& event : late_events_.take_all())
      out.events.push_back({out.deliver.size(), std::move(event)});
    turn.blocked = blocked || by_hand_.stands();
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
  if (replies_ != nullptr && !finish_answer(turn)) return wait(std::nullopt);
  if (handshake_ && turn.mode == Mode::deliver && preroll_over()) return end_preroll(turn);
  if (by_hand_.over(head)) end_step(turn);
  if (head == nullptr) return at_end(turn);
  if (!is_note(head->kind)) {
    pace_.reach(head->at);
    answers_signal_ = false;
  }
  switch (head->kind) {
    case RecordKind::read:
      return at_read(turn);
    case RecordKind::write:
      return at_write(turn);
    case RecordKind::open:
      return drives_ ? at_own_step(turn, &DriverLine::at_open) : at_open(turn);
    case RecordKind::close:
      return drives_ ? at_own_step(turn, &DriverLine::at_close) : at_close(turn);
    case RecordKind::hang_up:
      return drives_ ? at_driver_end(turn, true) : at_device_end(turn, &ReplayActions::hang_up);
    case RecordKind::half_close:
      return at_half_close(turn);
    case RecordKind::gap:
      return at_gap();
    case RecordKind::event:
      return drives_ ? at_own_step(turn, &DriverLine::at_event) : at_event(turn);
  }
  pop();
  return Progress::passed;
}

Player::Progress Player::at_event(Turn& turn) {
  const Record& head = *schedule_.head();
  const auto taped = head.event == nullptr ? std::nullopt : line_event_of(*head.event);
  if (taped && !schedule_.line_closed()) {
    const auto* signal = std::get_if<LineSignal>(&taped->what);
    const bool shown = signal == nullptr || shows_signals_;
    if (taped->by == Side::driver && signal != nullptr && shown) return at_driver_signal(turn, *signal);
    // Its settings are what the driver's are answered with (ReplayedDevice).
    const bool told = shown && !std::holds_alternative<line::Settings>(taped->what);
    if (taped->by == Side::device && told) return at_device_event(turn, taped->what);
  }
  pop();
  return Progress::passed;
}

// Due as a read would be. How a signal stood when the line came up is told then; a flush drops bytes alone.
Player::Progress Player::at_device_event(Turn& turn, const LineEvent& event) {
  const TapeTime at = schedule_.head()->at;
  pace_.reach(at);
  const auto* signal = std::get_if<LineSignal>(&event);
  const bool stood = signal != nullptr && signal->name != LineSignal::Name::brk &&
                     !signals_.told(signal->name) &&
                     session_bytes_ == schedule_.passed().reads + schedule_.passed().writes;
  if (!gate_opens(turn.now, at)) return Progress::waits;
  const Instant due = pace_.due(at);
  const bool at_once = stood || (signal != nullptr && answers_signal_ && due < turn.now + kAtOnce);
  const Instant when = at_once ? std::min(turn.now, due) : due;
  const bool passed_over =
      hung_up_ || turn.mode == Mode::drop_all || (turn.mode != Mode::deliver && passes_over(turn, when));
  if (!hung_up_ && turn.mode != Mode::drop_all && passed_over) late_events_.put(event);
  if (!passed_over) {
    if (turn.blocked) return wait(std::nullopt);
    if (turn.mode != Mode::deliver || early(turn, when)) return wait(when);
    turn.out->events.push_back({turn.out->deliver.size(), event});
  }
  if (signal != nullptr) signals_.tell(signal->name);
  if (!at_once || passed_over) pace_.played(at, when, passed_over ? when : turn.now);
  pop();
  return Progress::passed;
}

// A gate like a write: what follows is timed from it. One that never comes is waited for with patience.
Player::Progress Player::at_driver_signal(Turn& turn, const LineSignal& signal) {
  const TapeTime at = schedule_.head()->at;
  pace_.reach(at);
  if (gated() && turn.mode != Mode::drop_all) {
    if (!gate_opens(turn.now, at)) return Progress::waits;
    std::optional<Instant> since = signals_.take(signal);
    const Instant patience = gate_.patience_end(at);
    if (!since && turn.now < patience) return wait(patience);
    if (!since) since = patience;
    pace_.go_on_from(at, *since, *since);
  }
  const Instant when = pace_.real(at);
  if (!gated() && turn.mode == Mode::deliver && early(turn, when)) return wait(when);
  pop();
  answers_signal_ = true;
  return Progress::passed;
}

void Player::pop() {
  if (handshake_) handshake_->passed(*schedule_.head());
  schedule_.pop();
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
  if (head.data.empty() || schedule_.line_closed() || hung_up_ || !driver_line_.is_open()) {
    reads_excused_ += schedule_.rest().size();
    schedule_.pop();
    return Progress::passed;
  }
  take_request_time();
  if (!gate_opens(turn.now, head.at)) return Progress::waits;
  if (answer_is_left_out(turn)) return excuse_read();
  arrivals_.look(head, schedule_);
  const Instant when = pace_.due(arrivals_.first());
  if (turn.mode == Mode::drop_all || (turn.mode != Mode::deliver && passes_over(turn, when))) {
    pace_.played(head.at, when, when);
    return turn.mode == Mode::flush ? excuse_read() : pass_read();
  }
  if (turn.blocked) return wait(std::nullopt);
  if (turn.mode != Mode::deliver || early(turn, when)) return wait(when);
  if (const auto until = pieces_.held_until(turn.now, when)) {
    holds_piece_ = true;
    return wait(until);
  }
  // A block is cut only where it does not fit a delivery of its own: it may be a datagram.
  const ByteView piece = next_piece();
  const bool cut = turn.room < piece.size() && !turn.out->deliver.empty();
  if (turn.room == 0 || cut) return wait(turn.now);
  deliver(turn, piece, when);
  return Progress::passed;
}

Player::Progress Player::excuse_read() {
  reads_excused_ += schedule_.rest().size();
  return pass_read();
}

// It reaches nobody.
Player::Progress Player::pass_read() {
  if (replies_ != nullptr) (void)replies_->answer(read_of(schedule_.rest()));
  schedule_.pop();
  return Progress::passed;
}

// What the device says behind writes that the driver left out, all of them since its words before.
bool Player::answer_is_left_out(const Turn& turn) {
  const std::uint64_t asked = schedule_.passed().writes;
  if (asked != asked_) {
    answer_ = matcher_.left_out(std::exchange(asked_, asked), asked);
    if (answer_ == LeftOut::not_known && turn.mode == Mode::deliver) ++doubtful_answers_;
  }
  return answer_ == LeftOut::with_answer;
}

ByteView Player::next_piece() {
  const ByteView rest = schedule_.rest();
  const std::uint64_t offset = schedule_.head()->stream_offset + schedule_.head()->data.size() - rest.size();
  return rest.first(pieces_.size(offset, rest.size()));
}

void Player::deliver(Turn& turn, ByteView piece, Instant when) {
  ReplayActions& out = *turn.out;
  const ByteView part = piece.first(std::min(piece.size(), turn.room));
  const bool all = part.size() == schedule_.rest().size();
  if (!delivered_due_) delivered_due_ = pieces_.cut() ? pieces_.free_at(when) : when;
  pieces_.delivered(turn.now);
  const bool goes_on = arrivals_.continues() && !pieces_.cut();
  if (replies_ == nullptr) {
    append(out, part, goes_on);
  } else {
    append(out, replies_->answer(read_of(part)), goes_on);
  }
  pace_.played(schedule_.head()->at, when, turn.now);
  if (gated()) think_times_.answered(schedule_.head()->at, turn.now);
  answered_by_hand(turn, schedule_.head()->at);
  loops_.spoke();
  untimed_ = false;
  matcher_.answered();
  driver_line_.answered();
  settings_.delivered();
  gaps_reached_ = schedule_.gaps_passed();
  schedule_.take(part.size());
  if (all) {
    pop();
  } else {
    arrivals_.delivered_part();
  }
}

void Player::append(ReplayActions& out, ByteView bytes, bool goes_on) {
  if (bytes.empty()) return;
  out.deliver.insert(out.deliver.end(), bytes.begin(), bytes.end());
  if (goes_on && !out.block_ends.empty()) {
    out.block_ends.back() = out.deliver.size();
  } else {
    out.block_ends.push_back(out.deliver.size());
  }
}

// What was kept of an answer comes with its last read, unless the line takes nothing now.
bool Player::finish_answer(Turn& turn) {
  const Record* head = schedule_.head();
  const bool answer_goes_on = head != nullptr && (head->kind == RecordKind::read || is_note(head->kind));
  if (answer_goes_on || !replies_->keeps()) return true;
  if (turn.mode == Mode::deliver && turn.blocked) return false;
  const Bytes rest = replies_->rest();
  if (turn.mode != Mode::deliver) return true;
  if (!delivered_due_) delivered_due_ = turn.now;
  append(*turn.out, rest, true);
  return true;
}

Replies::Read Player::read_of(ByteView bytes) {
  const Schedule::Totals& passed = schedule_.passed();
  const std::uint64_t taken = schedule_.head()->data.size() - schedule_.rest().size();
  return {bytes, passed.reads + taken, passed.writes};
}

// Of its line or of its sending: due as a read would be.
Player::Progress Player::at_device_end(Turn& turn, bool ReplayActions::*what) {
  const TapeTime at = schedule_.head()->at;
  if (!schedule_.line_closed()) {
    if (!gate_opens(turn.now, at)) return Progress::waits;
    const Instant when = pace_.due(at);
    const bool dropped =
        hung_up_ || turn.mode == Mode::drop_all || (turn.mode == Mode::drop_due && when <= turn.now);
    if (!dropped) {
      if (turn.blocked) return wait(std::nullopt);
      if (turn.mode != Mode::deliver || early(turn, when)) return wait(when);
      turn.out->*what = true;
      answered_by_hand(turn, at);
    }
    pace_.played(at, when, dropped ? when : turn.now);
    schedule_.pop();
    return dropped ? Progress::passed : wait(turn.now);  // what follows comes behind it
  }
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_half_close(Turn& turn) {
  const auto* half_close = std::get_if<event::HalfClose>(schedule_.head()->event);
  const bool by_device = half_close != nullptr && half_close->by == Side::device;
  return by_device ? at_device_end(turn, &ReplayActions::end_sending) : at_driver_end(turn, half_closes_);
}

// One that comes late has come.
void Player::set_writing_ended(std::optional<Instant> since) {
  writing_ended_ = since;
  if (since && missed_half_close_ && *missed_half_close_ >= session_start_) missed_half_close_.reset();
}

// A gate like a write: what follows is timed from the driver's own end of writing, which a close is too. One
// that never comes is waited for with patience. `seen`: it would be seen on this line.
Player::Progress Player::at_driver_end(Turn& turn, bool seen) {
  const TapeTime at = schedule_.head()->at;
  if (seen && !schedule_.line_closed()) {
    const Instant when = pace_.real(at);
    if (turn.mode == Mode::flush) return wait(std::nullopt);
    if (!gated() && turn.mode == Mode::deliver && early(turn, when)) return wait(when);
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

// What the driver does with its line, where the tape plays it: one step a call.
Player::Progress Player::at_own_step(const Turn& turn,
                                     DriverLine::Answer (DriverLine::*way)(Instant,
                                                                           std::optional<LineStep>&)) {
  if (turn.mode != Mode::deliver) return wait(std::nullopt);
  const DriverLine::Answer answer = (driver_line_.*way)(turn.now, turn.out->line_step);
  if (!answer.done) return wait(answer.until);
  schedule_.pop();
  return turn.out->line_step ? wait(turn.now) : Progress::passed;
}

void Player::line_opened(Instant now) {
  if (!driver_line_.opening() || schedule_.head() == nullptr) return;
  driver_line_.opened();
  writing_ended_.reset();
  session_start_ = schedule_.head()->at;
  schedule_.pop();
  pace_.go_on_from(session_start_, now, now);
  matcher_.answered();
  wake_ = now;
}

void Player::line_ended(Instant now) {
  driver_line_.ended();
  if (!writing_ended_) set_writing_ended(now);
}

Player::Progress Player::at_write(Turn& turn) {
  const Record& head = *schedule_.head();
  driver_line_.pass_answer(head.at);
  const std::uint64_t end = schedule_.passed().writes + head.data.size();
  if (gated() && !head.data.empty()) {
    think_times_.expect(end, head.at, schedule_.exchange_of(end - 1));
    if (checks_time() && matcher_.comparing() && !gate_.pending()) return at_timed_write(turn);
    gate_.add_write(end, head.at);
  }
  // By the recorded clock a write holds nothing up; the walk only keeps to its time.
  const Instant when = pace_.real(head.at);
  if (!gated() && turn.mode == Mode::deliver && early(turn, when)) return wait(when);
  pop();
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
  take_request_time();
  if (!head.last_piece()) {
    schedule_.pop();
    return Progress::passed;
  }
  if (!std::exchange(untimed_, false)) {
    fault_ = compare_time(*done, head.at, done->real - pace_.after_last(head.at), head.data);
  }
  gate_.pass(end, head.at, done->real);
  schedule_.pop();
  return fault_ ? Progress::fault : Progress::passed;
}

void Player::take_request_time() {
  const auto next = think_times_.expected();
  if (!next || !matcher_.comparing()) return;
  if (const auto done = matcher_.completion(*next)) think_times_.came(done->real, config_.rate);
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

Player::Progress Player::at_close(Turn& turn) {
  if (turn.mode != Mode::deliver) return wait(std::nullopt);
  const Instant when = pace_.real(schedule_.head()->at);
  if (!gated() && early(turn, when)) return wait(when);
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_open(Turn& turn) {
  if (turn.mode != Mode::deliver || hung_up_) return wait(std::nullopt);
  const TapeTime at = schedule_.head()->at;
  const Instant when = pace_.real(at);
  if (!gated()) {
    if (early(turn, when)) return wait(when);
    loops_.session_began();
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
  loops_.session_began();
  session_start_ = at;
  schedule_.pop();
  return Progress::passed;
}

Player::Progress Player::at_end(Turn& turn) {
  if (schedule_.error()) return wait(std::nullopt);
  take_request_time();
  if (!gate_opens(turn.now, gate_.at())) return Progress::waits;
  if (!gate_.lenient()) {
    const std::optional<bool> all_came = matcher_.at_end();
    if (!all_came) return wait(turn.now);
    if (!*all_came) return wait(std::nullopt);
  }
  if (drives_) {
    if (const DriverLine::Answer over = driver_line_.at_end(turn.now); !over.done) return wait(over.until);
  }
  gaps_reached_ = schedule_.gaps_passed();
  if (!loops_.is_last()) return at_loop_end(turn);
  used_up_ = true;
  return wait(std::nullopt);
}

// The next loop begins where this one is over: at the end of the part, or with the last on the tape, by
// absolute times. A tape without any time still lets others have some.
Player::Progress Player::at_loop_end(Turn& turn) {
  if (turn.mode != Mode::deliver || turn.blocked || hung_up_) return wait(std::nullopt);
  const bool by_clock = config_.timing == Timing::recorded;
  Instant over = std::max(pace_.floor(), saturating_add(loops_.begun(), kShortestLoop));
  if (config_.end || by_clock) over = std::max(over, pace_.due(config_.end.value_or(schedule_.latest())));
  if (early(turn, over)) return wait(over);
  // By hand a device that has nothing to say would be asked for ever.
  if (comes_by_hand(turn) && !loops_.has_spoken()) end_step(turn);
  begin_next_loop(over);
  return wait(turn.now);
}

bool Player::early(Turn& turn, Instant when) const {
  if (turn.now >= when) return false;
  if (!comes_by_hand(turn)) return true;
  pace_.clock().move_to(when);
  turn.now = when;
  return false;
}

void Player::answered_by_hand(const Turn& turn, TapeTime at) {
  if (comes_by_hand(turn)) by_hand_.answered(at);
}

void Player::end_step(Turn& turn) {
  by_hand_.end();
  if (!by_hand_.under_way()) turn.blocked = true;
}

TapeTime Player::position(Instant now) const {
  const TapeTime passed = std::max(schedule_.latest(), session_start_);
  const TapeTime next = schedule_.known_head_at().value_or(passed);
  if (handshake_) return passed;
  return std::clamp(pace_.tape(now), passed, std::max(passed, next));
}

void Player::begin_preroll(TapeTime at) {
  handshake_.emplace(at);
  prerolled_ = schedule_.passed();
}

bool Player::preroll_over() {
  const Record* head = schedule_.head();
  return head == nullptr || head->at >= config_.start || handshake_->over(*head);
}

Player::Progress Player::end_preroll(const Turn& turn) {
  const Record* head = schedule_.head();
  if (!gate_opens(turn.now, head == nullptr ? gate_.at() : head->at)) return Progress::waits;
  prerolled_.reads = schedule_.passed().reads - prerolled_.reads;
  prerolled_.writes = schedule_.passed().writes - prerolled_.writes;
  handshake_.reset();
  pace_.hurry(false);
  jump(config_.start, turn.now);
  return Progress::passed;
}

bool Player::pass_events() {
  const auto stands_at_one = [this] {
    return schedule_.head() != nullptr && schedule_.head()->kind == RecordKind::event;
  };
  while (!budget_.spent() && stands_at_one()) schedule_.pop();
  return !stands_at_one();
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
  Nanos error = now - pace_.real(step.at);
  // Of gaps ahead of the walk it is not known yet how they are cut: early is what comes before the walk's
  // own.
  if (const auto known = pace_.cuts_known_to(); known && step.at > *known)
    error = std::clamp(Nanos{}, error, now - pace_.real(*known));
  return compare_time({matcher_.position(), matcher_.written(), now}, step.at, error,
                      matcher_.latest(step.block_size));
}

std::optional<Player::TimingFault> Player::compare_time(const Matcher::Completion& done, TapeTime at,
                                                        Nanos error, ByteView bytes) const {
  const Nanos margin = config_.jitter;
  const ReplayClock::Shift shift = pace_.shift();
  const bool late = error - shift.moved > margin && !config_.late_allowed;
  const bool early = error + shift.stood < -margin;
  if (!late && !early) return std::nullopt;
  TimingFault fault;
  fault.driver_offset = done.driver_end - std::min<std::uint64_t>(done.driver_end, 1);
  fault.tape_offset = done.tape_end - std::min<std::uint64_t>(done.tape_end, 1);
  fault.at = at;
  fault.real = done.real;
  fault.error = std::chrono::round<Micros>(error);
  const ByteView shown = bytes.first(std::min(bytes.size(), Mismatch::kMostShown));
  fault.bytes.assign(shown.begin(), shown.end());
  return fault;
}

}  // namespace porttape
