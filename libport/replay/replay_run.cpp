#include "libport/replay/replay_run.hpp"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "libport/replay/run_doubts.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostMismatchesHeld = 16;  // between two calls of advance(); the rest is only counted

ReplayConfig effective(ReplayConfig config, const Engine::Parts& parts) {
  if (parts.clock != nullptr) config.rate = parts.clock->rate();
  if (config.timing == Timing::none) config.strictness = std::min(config.strictness, 1);
  return config;
}

// Under match=lookup no silence opens a gate: there is none but the recorded opens.
ReplayConfig of_player(ReplayConfig config) {
  if (config.match == Match::lookup) config.strictness = 1;
  return config;
}

// The recorded clock goes on by itself, and at strictness 0 there is no mismatch.
bool looks_ever(const ReplayConfig& config, const Engine::Parts& parts) {
  if (config.match == Match::lookup) return true;
  return config.on_mismatch == OnMismatch::resync && config.timing != Timing::recorded &&
         config.strictness > 0 && config.writer == Writer::driver && parts.index != nullptr;
}

std::optional<Instant> earlier(std::optional<Instant> one, std::optional<Instant> other) {
  return one && other ? std::min(*one, *other) : one ? one : other;
}

}  // namespace

ReplayRun::ReplayRun(const ReplayConfig& config, const Engine::TapeFacts& facts, const Engine::Parts& parts,
                     RecordSource& schedule, RecordSource& writes, Budget& budget)
    : config_(effective(config, parts)),
      hang_ups_(drives() ? std::vector<TapeTime>() : facts.hang_ups),
      opens_(facts.opens),
      ruled_(parts.expectation != nullptr),
      leaves_out_(ruled_ && parts.expectation->leaves_out()),
      totals_(facts.totals),
      gaps_(facts.gaps),
      budget_(budget),
      own_clock_(config_.rate, ReplayClock::Sessions::set_it),
      clock_(parts.clock != nullptr ? *parts.clock : own_clock_),
      line_(facts.line),
      pieces_(config_.chunks, config_.chunk_seed),
      replies_(parts.expectation != nullptr ? parts.expectation->replies() : nullptr),
      lookup_(looks_ever(config_, parts)
                  ? std::make_unique<Lookup>(config_, facts, parts, budget, pieces_, clock_, replies_.get())
                  : nullptr),
      unasked_(schedule),
      matcher_(config_.match == Match::lookup ? static_cast<RecordSource&>(none_) : writes, budget, clock_,
               config_.burst_gap, parts.expectation),
      player_(of_player(config_), facts, {clock_, parts.tape_begin}, parts.half_closes,
              config_.match == Match::lookup ? static_cast<RecordSource&>(unasked_) : schedule, budget,
              matcher_, settings_, pieces_) {
  matcher_.set_replies(replies_.get());
  if (!looks_up()) player_.set_replies(replies_.get());
  if (config_.strictness > 0) matcher_.set_gaps(gaps_);
}

ReplayRun::~ReplayRun() {
  if (ledger_) clock_.leave();
}

void ReplayRun::begin(Instant now) {
  begin_books(now);
  matcher_.rewind();
  player_.begin(now);
  if (lookup_) lookup_->begin_run();
  stop_if_damaged(now);
}

void ReplayRun::begin_behind_end(Instant now) {
  begin_books(now);
  behind_end_ = tape_end_told_ = true;
  matcher_.rewind();
  matcher_.go_to(TapeTime::max());
  if (lookup_) lookup_->begin_behind_end();
}

void ReplayRun::begin_books(Instant now) {
  behind_end_ = tape_end_told_ = ends_with_line_ = false;
  extra_.reset();
  awaits_jump_.reset();
  matched_before_loop_ = 0;
  clock_.join();
  steered_ = {};
  if (clock_.stands()) steered_.pauses = 1;
  begun_shift_ = clock_.shift();
  furthest_ = before_latest_ = 0;
  ledger_.emplace(now);
  if (replies_) replies_->begin();
  settings_.begin(line_, shows_signals_);
  resyncing_ = false;
  question_.clear();
}

void ReplayRun::stand(Instant real, bool on) {
  if (on && !clock_.stands()) ++steered_.pauses;
  if (on) {
    clock_.stand(real);
  } else {
    clock_.go_on(real);
  }
  player_.hold(on);  // what was to come by hand is forgotten, though nobody looks before the next pause
}

void ReplayRun::step(std::uint64_t exchanges) {
  steered_.steps += exchanges;
  player_.step(exchanges);
}

void ReplayRun::set_rate(Instant now, double rate) {
  ++steered_.rates;
  clock_.set_rate(rate, now);
  player_.set_rate(rate, now);
  if (lookup_) lookup_->player().set_rate(rate, now);
}

void ReplayRun::seek(Instant now, TapeTime to) {
  if (!ledger_) return;
  ++steered_.seeks;
  furthest_ = std::max(furthest_, matcher_.position());
  tape_end_told_ = false;
  player_.jump(to, now);
}

void ReplayRun::begin_next_loop(Instant now) {
  furthest_ = std::max(furthest_, matcher_.position());
  matched_before_loop_ = matcher_.matched();
  player_.begin_next_loop(now);
}

void ReplayRun::begin_session() {
  exchanged_ = writing_ended_ = device_gone_ = sending_ended_ = false;
  before_latest_ = matcher_.position();
  player_.set_writing_ended(std::nullopt);
  player_.set_hung_up(false);
  pieces_.begin({});
  if (lookup_) lookup_->begin_session();
}

void ReplayRun::end_writing(Instant now) {
  writing_ended_ = true;
  player_.set_writing_ended(now);
  end_of_writes(now);
}

void ReplayRun::line_opened(Instant now) {
  if (!drives() || !player_.driver_line().opening()) return;
  count_session();
  begin_session();
  player_.line_opened(now);
}

std::optional<bool> ReplayRun::line_may_end() {
  return ledger_ ? player_.sessions().line_may_end() : std::optional(true);
}

bool ReplayRun::take_writing_ended() { return std::exchange(writing_ended_, false); }

void ReplayRun::set_blocked(bool blocked) {
  blocked_ = blocked;
  was_blocked_ = was_blocked_ || blocked;
}

std::optional<Matcher::Unsent> ReplayRun::first_unsent() {
  return ledger_ ? matcher_.first_unsent() : std::nullopt;
}

void ReplayRun::realign_to_walk() {
  const std::uint64_t there = player_.schedule().passed().writes;
  const bool can = config_.strictness == 0 || !fails();
  if (can && (!matcher_.comparing() || matcher_.position() < there)) matcher_.realign(there);
  resyncing_ = false;
  question_.clear();
}

std::size_t ReplayRun::write(Instant now, ByteView data, bool counted) {
  if (!ledger_) return data.size();
  awaits_jump_.reset();
  if (!counted) {
    before_latest_ = matcher_.position();
    ledger_->written(data, looks_up() ? lookup_->written() : matcher_.written());
  }
  exchanged_ = true;
  ledger_->byte(now);
  pause_if_due(now);
  if (looks_up()) return ask(now, data);
  const bool recorded = config_.timing == Timing::recorded;
  if (recorded && !matcher_.comparing() && now >= clock_.silent(matcher_.last_write(), config_.quiet)) {
    matcher_.realign_to_time(player_.tape(now - config_.jitter));
  }
  ByteView rest = data;
  const bool compares = !device_gone_ || matcher_.comparing();
  while (ledger_ && compares && (!rest.empty() || matcher_.goes_on())) {
    const Matcher::Step step = matcher_.write(now, rest, next_hang_up());
    if (resyncs()) note_question(rest.first(step.used));
    rest = rest.subspan(step.used);
    if (step.outcome == Matcher::Outcome::block) {
      if (const auto fault = player_.check_recorded(step, now)) tell_fault(now, *fault);
    } else if (matcher_.error() || step.outcome == Matcher::Outcome::gone) {
      break;
    } else if (step.outcome == Matcher::Outcome::later) {
      return data.size() - rest.size();
    } else if (step.outcome == Matcher::Outcome::extra && another_loop()) {
      awaits_jump_ = player_.jumps();
      return data.size() - rest.size();
    } else if (step.outcome == Matcher::Outcome::extra && drives()) {
      keep_extra(now, rest);
      matcher_.diverge();
    } else if (step.outcome != Matcher::Outcome::taken) {
      tell_difference(now, rest);
      matcher_.diverge();
      if (resyncs()) {
        resync(now, rest);
        break;
      }
    }
  }
  stop_if_damaged(now);
  return data.size();
}

// From here on the driver's requests are found wherever the tape has them, the one under way first.
void ReplayRun::resync(Instant now, ByteView rest) {
  if (!ledger_) return;
  resyncing_ = true;
  lookup_->go_on_from(matcher_.position(), matcher_.written(), question_.size());
  note_question(rest);
  matcher_.pass_over(rest.size());
  lookup_->write(now, std::exchange(question_, {}));
  find_asked(now);
}

// A driver whose question is longer is found by its end.
void ReplayRun::note_question(ByteView came) {
  constexpr std::size_t kLongest = 65536;
  question_.insert(question_.end(), came.begin(), came.end());
  if (question_.size() > kLongest)
    question_.erase(question_.begin(), question_.end() - static_cast<std::ptrdiff_t>(kLongest));
}

// The tape is read through before the first request is looked for.
std::size_t ReplayRun::ask(Instant now, ByteView data) {
  if (!ledger_ || device_gone_) return data.size();
  const bool ready = lookup_->ready();
  if (ready) {
    lookup_->write(now, data);
    if (resyncing_) matcher_.pass_over(data.size());
    find_asked(now);
  }
  stop_if_damaged(now);
  return ready || !ledger_ ? data.size() : 0;
}

void ReplayRun::find_asked(Instant now) {
  while (ledger_) {
    std::optional<Mismatch> mismatch = lookup_->find();
    if (const std::string where = lookup_->take_went_on(); !where.empty()) ledger_->went_on(where);
    if (!mismatch) return;
    if (config_.strictness == 0) continue;
    mismatch->real = ledger_->since_begin(now);
    ledger_->place_in_write(*mismatch);
    add_mismatch(now, *mismatch);
  }
}

// The recorded hang-up that is next, or has just broken the driver's line, while the bytes are compared: what
// is recorded before it may still come.
std::optional<TapeTime> ReplayRun::next_hang_up() {
  const std::size_t passed = player_.schedule().hang_ups_passed();
  const std::size_t next = passed - std::min<std::size_t>(passed, device_gone_ ? 1 : 0);
  if (!matcher_.comparing() || next >= hang_ups_.size()) return std::nullopt;
  return hang_ups_[next];
}

void ReplayRun::pause(Instant now) {
  if (!ledger_) return;
  if (looks_up()) {
    lookup_->pause();
    return find_asked(now);
  }
  if (!matcher_.pause_due()) return;
  compare_behind(now, matcher_.pause());
  stop_if_damaged(now);
}

void ReplayRun::end_of_writes(Instant now) {
  if (!ledger_) return;
  if (looks_up()) return pause(now);
  while (ledger_ && matcher_.pause_due()) {
    const Matcher::Step step = matcher_.pause();
    compare_behind(now, step);
    if (step.outcome != Matcher::Outcome::block) break;
  }
  if (ledger_ && !device_gone_) compare_behind(now, matcher_.end_session());
  if (ledger_) settings_.closed(matcher_.position());
  stop_if_damaged(now);
}

// What came of comparing without new bytes.
void ReplayRun::compare_behind(Instant now, const Matcher::Step& step) {
  if (step.outcome == Matcher::Outcome::block) {
    if (const auto fault = player_.check_recorded(step, matcher_.last_write())) tell_fault(now, *fault);
  } else if (step.outcome == Matcher::Outcome::differs || step.outcome == Matcher::Outcome::extra) {
    tell_difference(now, {});
    matcher_.diverge();
    if (resyncs()) resync(now, {});
  }
}

void ReplayRun::pause_if_due(Instant now) {
  const std::optional<Instant> due = looks_up() ? lookup_->pause_due() : matcher_.pause_due();
  if (due && *due <= now) pause(now);
}

std::optional<Instant> ReplayRun::wake() const {
  if (!looks_up()) return earlier(player_.wake(), matcher_.pause_due());
  const std::optional<Instant> walk = walk_waits() ? std::nullopt : player_.wake();
  const std::optional<Instant> answer = answers_wait() ? std::nullopt : lookup_->player().wake();
  return earlier(walk, earlier(answer, lookup_->pause_due()));
}

void ReplayRun::play(Instant now, std::size_t max_bytes, ReplayActions& out) {
  pause_if_due(now);
  player_.hold(clock_.stands());
  if (ledger_ && walk_waits()) play_answers(now, max_bytes, out);
  while (ledger_ && !walk_waits()) {
    const Before before(out);
    const std::uint64_t loop = player_.loops().number();
    const std::uint64_t position = matcher_.position();
    const auto fault = player_.play(now, max_bytes, blocked_, out);
    count_delivered(now, before, out, player_.delivered_due());
    if (player_.loops().number() != loop) {
      exchanged_ = false;
      matched_before_loop_ = matcher_.matched();
      furthest_ = std::max(furthest_, position);
    }
    if (!fault) break;
    tell_fault(now, *fault);
    if (ledger_ && budget_.spent()) {
      player_.wake_at(now);
      break;
    }
  }
  if (ledger_ && looks_up() && !walk_waits() && !answers_wait()) play_answers(now, max_bytes, out);
  if (const auto next = wake(); !blocked_ && (!next || *next > now)) was_blocked_ = false;
  stop_if_damaged(now);
  if (ledger_ && writing_ended_ && !blocked_ && !clock_.stands() && !drives()) end_device(now, out);
  const bool used_up =
      resyncing_ ? lookup_->used_up() : player_.used_up() && (!looks_up() || lookup_->used_up());
  if (ledger_ && used_up && !tape_end_told_) at_tape_end(now);
}

void ReplayRun::play_answers(Instant now, std::size_t max_bytes, ReplayActions& out) {
  const Before before(out);
  (void)lookup_->ready();  // the tape may have been read through only now
  find_asked(now);
  if (!ledger_) return;
  lookup_->play(now, max_bytes, blocked_ || clock_.stands(), out);
  count_delivered(now, before, out, lookup_->player().delivered_due());
}

// What is new, due first at `due`. A device that has ended its sending says no more in that session, in
// whatever order its tape is played.
void ReplayRun::count_delivered(Instant now, Before before, ReplayActions& out, std::optional<Instant> due) {
  if (sending_ended_) {
    out.deliver.resize(before.bytes);
    std::erase_if(out.block_ends, [before](std::size_t end) { return end > before.bytes; });
    for (ReplayActions::Told& told : out.events) told.behind = std::min(told.behind, before.bytes);
    out.end_sending = before.ended;
  }
  const std::size_t fresh = out.deliver.size() - before.bytes;
  if (out.hang_up) hung_up();
  sending_ended_ = sending_ended_ || out.end_sending;
  if (out.end_sending && lookup_) lookup_->player().end_sending();
  ledger_->delivered(fresh);
  for (std::size_t n = before.events; n < out.events.size(); ++n) ledger_->told(out.events[n].event);
  exchanged_ = exchanged_ || fresh > 0;
  if (fresh > 0) ledger_->byte(now);
  if (fresh > 0) question_.clear();
  if (fresh > 0 && before.bytes == 0 && !was_blocked_ && !clock_.stands() && due)
    ledger_->lateness(now - *due);
}

void ReplayRun::hung_up() {
  device_gone_ = true;
  if (!drives()) player_.set_hung_up(true);
}

// To a driver that writes no more the device ends too, once nothing comes without further writes.
void ReplayRun::end_device(Instant now, ReplayActions& out) {
  if (looks_up() && !lookup_->player().idle()) return;
  const std::optional<bool> played = player_.sessions().session_played();
  if (!played) {
    player_.wake_at(now);
  } else if (*played || !player_.wake()) {
    writing_ended_ = false;
    out.hang_up = true;
    hung_up();
  }
}

// Settings are seen some time after they were made: what seems to be missing is judged once the driver has
// read what was delivered, and its line is closed.
void ReplayRun::at_tape_end(Instant now) {
  if (clock_.stands()) return;
  tape_end_told_ = true;
  if (drives()) return end(now, EndedBy::close);
  if (config_.at_end == AtEnd::idle) return;
  ends_with_line_ = config_.check_settings && !settings_so_far(EndedBy::other).missing.empty();
  if (config_.at_end == AtEnd::hangup || ends_with_line_) pending_.hang_up = true;
  if (ends_with_line_) return hung_up();
  pending_.exit = config_.at_end == AtEnd::exit;
  end(now);
}

void ReplayRun::line_went(Instant now) {
  if (!std::exchange(ends_with_line_, false) || !ledger_) return;
  pending_.exit = config_.at_end == AtEnd::exit;
  end(now);
}

// What a driver has not made that wrote all and closes it will not make; one that is kept from going on might
// have, and of one that stops in the middle only its own bytes show how far it came.
SettingsCheck::Reach ReplayRun::reach(std::optional<bool> any_unsent, EndedBy by) const {
  using Reach = SettingsCheck::Reach;
  if (any_unsent != false && config_.strictness > 0) return Reach::written;
  return any_unsent == false && by == EndedBy::close ? Reach::all : Reach::delivered;
}

// Where the tape's writes and the driver's may differ, their places do not compare.
std::optional<SettingsCheck::Place> ReplayRun::place_of_driver() {
  const bool in_order = config_.strictness > 0 && matcher_.comparing() && !looks_up() && config_.loops == 1 &&
                        steered_.seeks == 0;
  const bool same = !ruled_ && gaps_.empty() && hang_ups_.empty() && player_.schedule().output_flushes() == 0;
  if (!in_order || !same) return std::nullopt;
  return SettingsCheck::Place{matcher_.position(), before_latest_, sessions()};
}

SettingsReport ReplayRun::settings_so_far(EndedBy by) {
  return settings_.report(reach(any_unsent(), by), std::max(furthest_, matcher_.position()), sessions());
}

bool ReplayRun::pass_to_close() {
  return reach(any_unsent(), EndedBy::close) != SettingsCheck::Reach::all || player_.pass_events();
}

void ReplayRun::end(Instant now, EndedBy by) {
  tell_extra();
  const std::optional<bool> any_unsent = this->any_unsent();
  const bool half_close_missing = player_.missed_half_close().has_value();
  const bool unplayed = drives() && !player_.used_up();
  if (!behind_end_) ledger_->settings(settings_so_far(by));
  const bool cut_off = config_.match == Match::lookup && lookup_->cut_off();
  RunReport report = ledger_->report(
      config_, now,
      {.unsent = any_unsent.value_or(false) || half_close_missing || cut_off, .unplayed = unplayed});
  report.duration += behind();
  report.playback = playback(any_unsent == false && matcher_.any_unsent() == false &&
                             (player_.used_up() || matcher_.matched() > 0));
  report.missed_half_close = player_.missed_half_close();
  report.sessions_of = std::max<std::uint64_t>(1, opens_);
  report.from_driver_matched = matcher_.matched();
  report.delivered = fails() && report.mismatch ? report.mismatch->delivered : player_.reads_delivered();
  report.reads_excused = player_.reads_excused();
  report.output_flushes = player_.schedule().output_flushes();
  report.input_flushes = player_.schedule().input_flushes();
  report.ruled = ruled_;
  report.leaves_out = leaves_out_;
  report.rewritten = replies_ != nullptr;
  report.think_times = player_.think_times().times();
  report.closed = by == EndedBy::close;
  if (!any_unsent && ledger_->report(config_, now, {.unsent = true}).verdict != report.verdict) {
    report.undecided_from = matcher_.position();
  }
  if (const auto unsent = matcher_.first_unsent()) {
    report.next_expected = unsent->bytes;
    report.next_expected_block = unsent->block_after;
    report.next_expected_before = unsent->before;
    report.next_expected_offset = unsent->offset;
    report.next_expected_tape = unsent->at;
  }
  if (config_.match == Match::lookup) lookup_->report(report);
  if (totals_) add_totals(report, *totals_);
  add_gaps(report, gaps_, std::max(matcher_.gaps_reached(), player_.gaps_reached()));
  add_doubtful_answers(report, player_.doubtful_answers());
  pending_.run_ended = std::move(report);
  ledger_.reset();
  clock_.leave();
}

// Of all loops that it was to make; of endless ones the first counts, since the last is never whole.
std::optional<bool> ReplayRun::any_unsent() {
  const std::optional<bool> unsent = matcher_.any_unsent();
  if (config_.loops == 1) return unsent;
  if (config_.loops == 0) return player_.loops().number() > 1 ? matcher_.any_skipped() : unsent;
  const bool asked = matcher_.matched() > 0 || unsent != false;
  return player_.loops().is_last() || !asked ? unsent : true;
}

PlaybackReport ReplayRun::playback(bool complete) const {
  PlaybackReport played = steered_;
  played.start = config_.start;
  played.end = config_.end;
  played.preroll = config_.preroll;
  played.max_gap = config_.max_gap;
  played.loops = player_.loops().number();
  played.loops_complete = player_.loops().number() - (complete ? 0 : 1);
  played.loops_of = config_.loops == 0 ? std::nullopt : std::optional(config_.loops);
  played.prerolled = {.reads = player_.prerolled().reads, .writes = player_.prerolled().writes};
  played.paused = clock_.shift().stood - begun_shift_.stood;
  return played;
}

Micros ReplayRun::since_begin(Instant now) const {
  return ledger_->since_begin(now) + std::chrono::floor<Micros>(behind());
}

void ReplayRun::stop_if_damaged(Instant now) {
  if (!ledger_) return;
  const std::optional<Error>& found = error();
  if (!found) return;
  const std::string trouble = found->message;
  end(now);
  pending_.run_ended->trouble = trouble;
  if (pending_.run_ended->verdict == Verdict::pass) pending_.run_ended->verdict = Verdict::incomplete;
}

const std::optional<Error>& ReplayRun::error() {
  if (matcher_.error()) return matcher_.error();
  if (looks_up() && lookup_->error()) return lookup_->error();
  return player_.schedule().error();
}

Mismatch ReplayRun::difference(Instant now, ByteView got) {
  Mismatch mismatch = matcher_.describe(got);
  mismatch.real = since_begin(now);
  ledger_->place_in_write(mismatch);
  return mismatch;
}

void ReplayRun::tell_difference(Instant now, ByteView got) {
  if (config_.strictness > 0) tell_mismatch(now, difference(now, got));
}

// What a device sends beyond the tape is one only where it had been silent then, which the tape's end shows.
void ReplayRun::keep_extra(Instant now, ByteView got) {
  if (config_.strictness > 0 && !extra_) extra_ = difference(now, got);
}

void ReplayRun::tell_extra() {
  if (!extra_ || player_.driver_line().streams_on()) return;
  extra_->exchange = player_.schedule().exchange_of(extra_->tape_offset);
  ledger_->mismatch(*extra_);
  pending_.mismatches.push_back(*std::exchange(extra_, std::nullopt));
}

void ReplayRun::tell_fault(Instant now, const Player::TimingFault& fault) {
  Mismatch mismatch;
  mismatch.kind = MismatchKind::timing;
  mismatch.offset = fault.driver_offset;
  mismatch.tape_offset = fault.tape_offset;
  mismatch.tape = fault.at;
  mismatch.real = since_begin(fault.real);
  mismatch.error = fault.error;
  mismatch.allowed = std::chrono::round<Micros>(config_.jitter);
  mismatch.expected = mismatch.got = fault.bytes;
  mismatch.block_after = fault.bytes.size();
  mismatch.own_late = std::chrono::ceil<Micros>(ledger_->last_lateness());
  tell_mismatch(now, std::move(mismatch));
}

void ReplayRun::tell_mismatch(Instant now, Mismatch mismatch) {
  mismatch.delivered = player_.reads_delivered();
  // A run that ends here has no more use for the walk, so it may go ahead to where the driver is.
  if (fails()) player_.schedule().pass_write(mismatch.tape_offset);
  mismatch.exchange = player_.schedule().exchange_of(mismatch.tape_offset);
  add_mismatch(now, mismatch);
  if (ledger_ && mismatch.kind != MismatchKind::timing && !resyncs()) player_.become_lenient(now);
}

void ReplayRun::add_mismatch(Instant now, const Mismatch& mismatch) {
  ledger_->mismatch(mismatch);
  if (pending_.mismatches.size() < kMostMismatchesHeld) pending_.mismatches.push_back(mismatch);
  if (!fails()) return;
  pending_.hang_up = true;
  end(now);
}

// Until it is done or the budget is spent.
bool ReplayRun::walk(Instant now, Player::Settled (Player::*way)(Instant)) {
  while (ledger_) {
    const Player::Settled settled = (player_.*way)(now);
    if (settled.fault) {
      tell_fault(now, *settled.fault);
      continue;
    }
    if (settled.done) stop_if_damaged(now);
    return settled.done;
  }
  return true;
}

}  // namespace porttape
