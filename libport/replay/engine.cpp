#include "libport/replay/engine.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <string>
#include <utility>

#include "libport/replay/engine_impl.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostMismatchesHeld = 16;  // between two calls of advance(); the rest is only counted

constexpr std::size_t kMostGapsTold = 8;

std::string text_of(const TapeGap& gap) {
  const auto seconds = [](TapeTime at) {
    std::array<char, 48> text{};
    const std::int64_t us = to_us(at);
    std::snprintf(text.data(), text.size(), "%lld.%06lld s", static_cast<long long>(us / 1'000'000),
                  static_cast<long long>(us % 1'000'000));
    return std::string(text.data());
  };
  const std::string what = gap.bytes > 0 ? std::to_string(gap.bytes) + " bytes are" : "something is";
  return what + " missing on the tape from " + seconds(gap.from) + " to " + seconds(gap.to) +
         (gap.why.empty() ? "" : " (" + gap.why + ")") + ": what the driver wrote there was not compared";
}

ReplayConfig effective(ReplayConfig config, const Engine::Parts& parts) {
  if (parts.clock != nullptr) config.rate = parts.clock->rate();
  if (config.timing == Timing::none) config.strictness = std::min(config.strictness, 1);
  return config;
}

}  // namespace

Engine::Impl::Impl(const ReplayConfig& replay_config, const TapeFacts& facts, RecordSource& schedule,
                   RecordSource& write_source, const Parts& parts)
    : config(effective(replay_config, parts)),
      hang_ups(facts.hang_ups),
      totals(facts.totals),
      gaps(facts.gaps),
      own_clock(config.rate, ReplayClock::Sessions::set_it),
      matcher(write_source, budget, config.burst_gap, parts.expectation),
      player(config, facts, {parts.clock != nullptr ? *parts.clock : own_clock, parts.tape_begin}, schedule,
             budget, matcher) {
  if (config.strictness > 0) matcher.set_gaps(gaps);
}

void Engine::Impl::begin_run() {
  any_run = true;
  tape_end_told = false;
  run.emplace(now);
  matcher.rewind();
  player.begin(now);
  stop_if_damaged();
}

// Gives how much of it is done with.
std::size_t Engine::Impl::write(ByteView data, bool counted) {
  if (!run) return data.size();
  if (!counted) run->written(data.size());
  exchanged = true;
  const bool recorded = config.timing == Timing::recorded;
  if (recorded && !matcher.comparing() && now - matcher.last_write() >= config.quiet) {
    matcher.realign_to_time(player.timeline().tape(now - config.jitter));
  }
  ByteView rest = data;
  while (run && !rest.empty() && !device_gone) {
    const Matcher::Step step = matcher.write(now, rest, next_hang_up());
    rest = rest.subspan(step.used);
    if (step.outcome == Matcher::Outcome::block) {
      if (const auto fault = player.check_recorded(step, now)) tell_fault(*fault);
    } else if (matcher.error() || step.outcome == Matcher::Outcome::gone) {
      break;
    } else if (step.outcome == Matcher::Outcome::later) {
      return data.size() - rest.size();
    } else if (step.outcome != Matcher::Outcome::taken) {
      tell_difference(rest);
      matcher.diverge();
    }
  }
  stop_if_damaged();
  return data.size();
}

// The recorded hang-up that is next, while the bytes are compared.
std::optional<TapeTime> Engine::Impl::next_hang_up() {
  const std::size_t next = player.schedule().hang_ups_passed();
  if (!matcher.comparing() || next >= hang_ups.size()) return std::nullopt;
  return hang_ups[next];
}

ReplayActions Engine::Impl::advance(Instant at, std::size_t max_bytes) {
  budget.refill();
  work();
  now = std::max(now, at);
  dirty = false;
  if (!run && driver_open && std::exchange(writing_ended, false)) pending.hang_up = true;
  // The end of a run is told alone, so that nothing of the next run is mixed in.
  if (pending.run_ended || !run) {
    dirty = run.has_value() || !inputs.empty();
    return std::exchange(pending, {});
  }
  ReplayActions out;
  player.set_behind(!inputs.empty());
  if (driver_open && !switching()) play(max_bytes, out);
  dirty = dirty || !inputs.empty();
  out.mismatches = std::move(pending.mismatches);
  out.hang_up = out.hang_up || pending.hang_up;
  out.run_ended = std::move(pending.run_ended);
  out.exit = pending.exit;
  pending = {};
  return out;
}

void Engine::Impl::play(std::size_t max_bytes, ReplayActions& out) {
  while (run) {
    const std::size_t before = out.deliver.size();
    const auto fault = player.play(now, max_bytes, blocked, out);
    const std::size_t fresh = out.deliver.size() - before;
    device_gone = device_gone || out.hang_up;
    run->delivered(fresh);
    exchanged = exchanged || fresh > 0;
    if (fresh > 0 && before == 0 && !was_blocked) run->lateness(now - *player.delivered_due());
    if (!fault) break;
    tell_fault(*fault);
    if (run && budget.spent()) {
      player.wake_at(now);
      break;
    }
  }
  if (!blocked && (!player.wake() || *player.wake() > now)) was_blocked = false;
  stop_if_damaged();
  if (run && writing_ended && !blocked) {
    const std::optional<bool> played = player.sessions().session_played();
    if (!played) {
      player.wake_at(now);
    } else if (*played || !player.wake()) {
      writing_ended = false;
      out.hang_up = true;
    }
  }
  if (run && player.used_up() && !tape_end_told) at_tape_end();
}

void Engine::Impl::at_tape_end() {
  tape_end_told = true;
  if (config.at_end == AtEnd::idle) return;
  (config.at_end == AtEnd::hangup ? pending.hang_up : pending.exit) = true;
  end_run();
}

void Engine::Impl::end_run() {
  const std::optional<bool> any_unsent = matcher.any_unsent();
  RunReport report = run->report(config, now, any_unsent.value_or(false));
  report.from_driver_matched = matcher.matched();
  if (!any_unsent && run->report(config, now, true).verdict != report.verdict) {
    report.undecided_from = matcher.position();
  }
  if (const auto unsent = matcher.first_unsent()) {
    report.next_expected = unsent->bytes;
    report.next_expected_offset = unsent->offset;
    report.next_expected_tape = unsent->at;
  }
  if (totals) add_totals(report, *totals);
  add_gaps(report);
  pending.run_ended = std::move(report);
  run.reset();
}

// The gaps that the run came to.
void Engine::Impl::add_gaps(RunReport& report) {
  const std::size_t reached = std::max(matcher.gaps_reached(), player.gaps_reached());
  for (std::size_t i = 0; i < std::min(reached, gaps.size()); ++i) {
    if (i == kMostGapsTold) {
      report.doubts.push_back({Doubt::Kind::gap, "and " + std::to_string(reached - i) + " more gaps"});
      return;
    }
    report.doubts.push_back({Doubt::Kind::gap, text_of(gaps[i])});
  }
}

void Engine::Impl::stop_if_damaged() {
  if (!run) return;
  const auto& error = matcher.error() ? matcher.error() : player.schedule().error();
  if (!error) return;
  const std::string trouble = error->message;
  end_run();
  pending.run_ended->trouble = trouble;
  if (pending.run_ended->verdict == Verdict::pass) pending.run_ended->verdict = Verdict::incomplete;
}

void Engine::Impl::tell_difference(ByteView got) {
  if (config.strictness == 0) return;
  Mismatch mismatch = matcher.describe(got);
  mismatch.real = run->since_begin(now);
  tell_mismatch(std::move(mismatch));
}

void Engine::Impl::tell_fault(const Player::TimingFault& fault) {
  Mismatch mismatch;
  mismatch.kind = MismatchKind::timing;
  mismatch.offset = fault.driver_offset;
  mismatch.tape_offset = fault.tape_offset;
  mismatch.tape = fault.at;
  mismatch.real = run->since_begin(fault.real);
  mismatch.error = fault.error;
  mismatch.own_late = std::chrono::ceil<Micros>(run->last_lateness());
  tell_mismatch(std::move(mismatch));
}

void Engine::Impl::tell_mismatch(Mismatch mismatch) {
  // A run that ends here has no more use for the walk, so it may go ahead to where the driver is.
  if (fails()) player.schedule().pass_write(mismatch.tape_offset);
  mismatch.exchange = player.schedule().exchange_of(mismatch.tape_offset);
  run->mismatch(mismatch);
  if (pending.mismatches.size() < kMostMismatchesHeld) pending.mismatches.push_back(mismatch);
  if (fails()) {
    pending.hang_up = true;
    end_run();
  } else if (mismatch.kind != MismatchKind::timing) {
    player.become_lenient(now);
  }
}

Engine::Engine(const ReplayConfig& config, const TapeFacts& facts, RecordSource& schedule,
               RecordSource& writes, const Parts& parts)
    : impl_(std::make_unique<Impl>(config, facts, schedule, writes, parts)) {}

Engine::~Engine() = default;

void Engine::on_open(Instant now) { impl_->tell({.kind = Impl::Input::Kind::open, .at = now}); }
void Engine::on_write(Instant now, ByteView data) { impl_->tell_write(now, data); }
void Engine::on_writing_ended(Instant now) {
  impl_->tell({.kind = Impl::Input::Kind::writing_ended, .at = now});
}
void Engine::on_flush(Instant now) { impl_->tell({.kind = Impl::Input::Kind::flush, .at = now}); }
void Engine::on_close(Instant now) { impl_->tell({.kind = Impl::Input::Kind::close, .at = now}); }
void Engine::finish(Instant now) { impl_->tell({.kind = Impl::Input::Kind::finish, .at = now}); }

bool Engine::finished() const { return impl_->finished; }
void Engine::give_up(Instant now) { impl_->give_up(now); }
void Engine::set_totals(const TapeTotals& totals) { impl_->totals = totals; }
std::size_t Engine::backlog() const { return impl_->backlog; }

std::optional<Instant> Engine::next_deadline() const {
  if (impl_->dirty) return impl_->now;
  if (!impl_->run || !impl_->driver_open) return std::nullopt;
  return impl_->player.wake();
}

ReplayActions Engine::advance(Instant now, std::size_t max_bytes) { return impl_->advance(now, max_bytes); }

std::optional<Engine::Unsent> Engine::first_unsent() const {
  const auto unsent = impl_->run ? impl_->matcher.first_unsent() : std::nullopt;
  if (!unsent) return std::nullopt;
  return Unsent{unsent->offset, unsent->at, unsent->bytes};
}

void Engine::set_blocked(bool blocked) {
  impl_->blocked = blocked;
  impl_->was_blocked = impl_->was_blocked || blocked;
  impl_->dirty = true;
}

}  // namespace porttape
