#include "libport/replay/replay_run.hpp"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostMismatchesHeld = 16;  // between two calls of advance(); the rest is only counted

constexpr std::size_t kMostGapsTold = 8;

std::string text_of(const TapeGap& gap) {
  const std::string what = gap.bytes > 0 ? std::to_string(gap.bytes) + " bytes are" : "something is";
  return what + " missing on the tape from " + seconds_text(to_us(gap.from)) + " to " +
         seconds_text(to_us(gap.to)) + (gap.why.empty() ? "" : " (" + gap.why + ")") +
         ": what the driver wrote there was not compared";
}

ReplayConfig effective(ReplayConfig config, const Engine::Parts& parts) {
  if (parts.clock != nullptr) config.rate = parts.clock->rate();
  if (config.timing == Timing::none) config.strictness = std::min(config.strictness, 1);
  return config;
}

}  // namespace

ReplayRun::ReplayRun(const ReplayConfig& config, const Engine::TapeFacts& facts, const Engine::Parts& parts,
                     RecordSource& schedule, RecordSource& writes, Budget& budget)
    : config_(effective(config, parts)),
      hang_ups_(facts.hang_ups),
      opens_(facts.opens),
      totals_(facts.totals),
      gaps_(facts.gaps),
      budget_(budget),
      own_clock_(config_.rate, ReplayClock::Sessions::set_it),
      clock_(parts.clock != nullptr ? *parts.clock : own_clock_),
      matcher_(writes, budget, config_.burst_gap, parts.expectation),
      player_(config_, facts, {clock_, parts.tape_begin}, parts.half_closes, schedule, budget, matcher_) {
  if (config_.strictness > 0) matcher_.set_gaps(gaps_);
}

ReplayRun::~ReplayRun() {
  if (ledger_) clock_.leave();
}

void ReplayRun::begin(Instant now) {
  tape_end_told_ = false;
  writes_ = 0;
  sessions_ = 1;
  clock_.join();
  ledger_.emplace(now);
  matcher_.rewind();
  player_.begin(now);
  stop_if_damaged(now);
}

void ReplayRun::begin_session() {
  exchanged_ = writing_ended_ = device_gone_ = false;
  player_.set_writing_ended(std::nullopt);
}

void ReplayRun::end_writing(Instant now) {
  writing_ended_ = true;
  player_.set_writing_ended(now);
  pause(now);
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
}

std::size_t ReplayRun::write(Instant now, ByteView data, bool counted) {
  if (!ledger_) return data.size();
  if (!counted) {
    ledger_->written(data.size());
    ++writes_;
    write_begin_ = matcher_.written();
  }
  exchanged_ = true;
  pause_if_due(now);
  const bool recorded = config_.timing == Timing::recorded;
  if (recorded && !matcher_.comparing() && now - matcher_.last_write() >= config_.quiet) {
    matcher_.realign_to_time(player_.timeline().tape(now - config_.jitter));
  }
  ByteView rest = data;
  while (ledger_ && !rest.empty() && !device_gone_) {
    const Matcher::Step step = matcher_.write(now, rest, next_hang_up());
    rest = rest.subspan(step.used);
    if (step.outcome == Matcher::Outcome::block) {
      if (const auto fault = player_.check_recorded(step, now)) tell_fault(now, *fault);
    } else if (matcher_.error() || step.outcome == Matcher::Outcome::gone) {
      break;
    } else if (step.outcome == Matcher::Outcome::later) {
      return data.size() - rest.size();
    } else if (step.outcome != Matcher::Outcome::taken) {
      tell_difference(now, rest);
      matcher_.diverge();
    }
  }
  stop_if_damaged(now);
  return data.size();
}

// The recorded hang-up that is next, while the bytes are compared.
std::optional<TapeTime> ReplayRun::next_hang_up() {
  const std::size_t next = player_.schedule().hang_ups_passed();
  if (!matcher_.comparing() || next >= hang_ups_.size()) return std::nullopt;
  return hang_ups_[next];
}

void ReplayRun::pause(Instant now) {
  if (!ledger_ || !matcher_.pause_due()) return;
  const Matcher::Step step = matcher_.pause();
  if (step.outcome == Matcher::Outcome::block) {
    if (const auto fault = player_.check_recorded(step, matcher_.last_write())) tell_fault(now, *fault);
  }
  stop_if_damaged(now);
}

void ReplayRun::pause_if_due(Instant now) {
  if (const auto due = matcher_.pause_due(); due && *due <= now) pause(now);
}

std::optional<Instant> ReplayRun::wake() const {
  const std::optional<Instant> wake = player_.wake();
  const std::optional<Instant> pause = matcher_.pause_due();
  return wake && pause ? std::min(*wake, *pause) : wake ? wake : pause;
}

void ReplayRun::play(Instant now, std::size_t max_bytes, ReplayActions& out) {
  pause_if_due(now);
  while (ledger_) {
    const std::size_t before = out.deliver.size();
    const auto fault = player_.play(now, max_bytes, blocked_, out);
    const std::size_t fresh = out.deliver.size() - before;
    device_gone_ = device_gone_ || out.hang_up;
    ledger_->delivered(fresh);
    exchanged_ = exchanged_ || fresh > 0;
    if (fresh > 0 && before == 0 && !was_blocked_) ledger_->lateness(now - *player_.delivered_due());
    if (!fault) break;
    tell_fault(now, *fault);
    if (ledger_ && budget_.spent()) {
      player_.wake_at(now);
      break;
    }
  }
  if (!blocked_ && (!player_.wake() || *player_.wake() > now)) was_blocked_ = false;
  stop_if_damaged(now);
  if (ledger_ && writing_ended_ && !blocked_) end_device(now, out);
  if (ledger_ && player_.used_up() && !tape_end_told_) at_tape_end(now);
}

// To a driver that writes no more the device ends too, once nothing comes without further writes.
void ReplayRun::end_device(Instant now, ReplayActions& out) {
  const std::optional<bool> played = player_.sessions().session_played();
  if (!played) {
    player_.wake_at(now);
  } else if (*played || !player_.wake()) {
    writing_ended_ = false;
    out.hang_up = true;
  }
}

void ReplayRun::at_tape_end(Instant now) {
  tape_end_told_ = true;
  if (config_.at_end == AtEnd::idle) return;
  (config_.at_end == AtEnd::hangup ? pending_.hang_up : pending_.exit) = true;
  end(now);
}

void ReplayRun::end(Instant now) {
  const std::optional<bool> any_unsent = matcher_.any_unsent();
  const bool half_close_missing = player_.missed_half_close().has_value();
  RunReport report = ledger_->report(config_, now, any_unsent.value_or(false) || half_close_missing);
  report.missed_half_close = player_.missed_half_close();
  report.sessions_made = sessions_;
  report.sessions_of = std::max<std::uint64_t>(1, opens_);
  report.from_driver_matched = matcher_.matched();
  if (!any_unsent && ledger_->report(config_, now, true).verdict != report.verdict) {
    report.undecided_from = matcher_.position();
  }
  if (const auto unsent = matcher_.first_unsent()) {
    report.next_expected = unsent->bytes;
    report.next_expected_block = unsent->block_after;
    report.next_expected_before = unsent->before;
    report.next_expected_offset = unsent->offset;
    report.next_expected_tape = unsent->at;
  }
  if (totals_) add_totals(report, *totals_);
  add_gaps(report);
  pending_.run_ended = std::move(report);
  ledger_.reset();
  clock_.leave();
}

// The gaps that the run came to.
void ReplayRun::add_gaps(RunReport& report) const {
  const std::size_t reached = std::max(matcher_.gaps_reached(), player_.gaps_reached());
  for (std::size_t i = 0; i < std::min(reached, gaps_.size()); ++i) {
    if (i == kMostGapsTold) {
      report.doubts.push_back({Doubt::Kind::gap, "and " + std::to_string(reached - i) + " more gaps"});
      return;
    }
    report.doubts.push_back({Doubt::Kind::gap, text_of(gaps_[i])});
  }
}

void ReplayRun::stop_if_damaged(Instant now) {
  if (!ledger_) return;
  const auto& error = matcher_.error() ? matcher_.error() : player_.schedule().error();
  if (!error) return;
  const std::string trouble = error->message;
  end(now);
  pending_.run_ended->trouble = trouble;
  if (pending_.run_ended->verdict == Verdict::pass) pending_.run_ended->verdict = Verdict::incomplete;
}

void ReplayRun::tell_difference(Instant now, ByteView got) {
  if (config_.strictness == 0) return;
  Mismatch mismatch = matcher_.describe(got);
  mismatch.real = ledger_->since_begin(now);
  mismatch.write = writes_;
  mismatch.write_offset = mismatch.offset - write_begin_;
  tell_mismatch(now, std::move(mismatch));
}

void ReplayRun::tell_fault(Instant now, const Player::TimingFault& fault) {
  Mismatch mismatch;
  mismatch.kind = MismatchKind::timing;
  mismatch.offset = fault.driver_offset;
  mismatch.tape_offset = fault.tape_offset;
  mismatch.tape = fault.at;
  mismatch.real = ledger_->since_begin(fault.real);
  mismatch.error = fault.error;
  mismatch.allowed = std::chrono::round<Micros>(config_.jitter);
  mismatch.expected = mismatch.got = fault.bytes;
  mismatch.block_after = fault.bytes.size();
  mismatch.own_late = std::chrono::ceil<Micros>(ledger_->last_lateness());
  tell_mismatch(now, std::move(mismatch));
}

void ReplayRun::tell_mismatch(Instant now, Mismatch mismatch) {
  // A run that ends here has no more use for the walk, so it may go ahead to where the driver is.
  if (fails()) player_.schedule().pass_write(mismatch.tape_offset);
  mismatch.exchange = player_.schedule().exchange_of(mismatch.tape_offset);
  ledger_->mismatch(mismatch);
  if (pending_.mismatches.size() < kMostMismatchesHeld) pending_.mismatches.push_back(mismatch);
  if (fails()) {
    pending_.hang_up = true;
    end(now);
  } else if (mismatch.kind != MismatchKind::timing) {
    player_.become_lenient(now);
  }
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
