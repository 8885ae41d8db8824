#include "libport/replay/engine.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include "libport/replay/engine_impl.hpp"
#include "libport/replay/hint.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kMostHints = 8;          // a run; each may read far on the tape
constexpr std::size_t kMostMismatchesHeld = 16;  // between two calls of advance(); the rest is only counted

ReplayConfig effective(ReplayConfig config) {
  if (config.timing == Timing::none) config.strictness = std::min(config.strictness, 1);
  return config;
}

}  // namespace

Engine::Impl::Impl(const ReplayConfig& replay_config, const TapeFacts& facts, RecordSource& schedule,
                   RecordSource& write_source)
    : config(effective(replay_config)),
      hang_ups(facts.hang_ups),
      writes(write_source),
      matcher(write_source, config.burst_gap),
      player(config, facts, schedule, matcher) {}

void Engine::Impl::open(Instant at) {
  now = at;
  dirty = true;
  if (driver_open && run) return;
  driver_open = true;
  if (run) {
    reopen();
  } else if (!any_run || config.on_reopen != OnReopen::continue_) {
    begin_run();
  } else if (config.at_end == AtEnd::hangup) {
    pending.hang_up = true;
  }
  exchanged = writing_ended = device_gone = false;
}

void Engine::Impl::begin_run() {
  any_run = true;
  tape_end_told = false;
  run.emplace(now);
  matcher.rewind();
  player.begin(now);
  stop_if_damaged();
}

void Engine::Impl::reopen() {
  switch (on_open) {
    case Reopen::restart_session:
      player.restart_session(now);
      break;
    case Reopen::resume:
      settle(Player::Lost::due);
      if (!run) return;
      player.resume(now);
      break;
    case Reopen::next_open: {
      player.continue_at_next_open(now);
      const std::uint64_t there = player.schedule().passed().writes;
      if (can_realign() && (!matcher.comparing() || matcher.position() < there)) matcher.realign(there);
      break;
    }
  }
  stop_if_damaged();
}

void Engine::Impl::write(Instant at, ByteView data) {
  now = at;
  dirty = true;
  if (!run || data.empty()) return;
  run->written(data.size());
  exchanged = true;
  if (device_gone) return;
  const bool recorded = config.timing == Timing::recorded;
  if (recorded && !matcher.comparing() && now - matcher.last_write() >= config.quiet) {
    matcher.realign_to_time(player.timeline().tape(now - config.jitter));
  }
  while (run && !data.empty()) {
    const std::uint64_t room = room_before_hang_up();
    if (room == 0) break;
    const Matcher::Step step = matcher.write(now, data.first(std::min<std::uint64_t>(room, data.size())));
    data = data.subspan(step.used);
    if (step.outcome == Matcher::Outcome::block) {
      if (const auto fault = player.check_recorded(step, now)) tell_fault(*fault);
    } else if (matcher.error()) {
      break;
    } else if (step.outcome != Matcher::Outcome::taken) {
      tell_difference(data);
      matcher.diverge();
    }
  }
  stop_if_damaged();
}

std::uint64_t Engine::Impl::room_before_hang_up() {
  const std::size_t next = player.schedule().hang_ups_passed();
  const bool ahead = matcher.comparing() && next < hang_ups.size() && hang_ups[next] >= matcher.position();
  return ahead ? hang_ups[next] - matcher.position() : std::numeric_limits<std::uint64_t>::max();
}

void Engine::Impl::close(Instant at) {
  now = at;
  dirty = true;
  driver_open = false;
  if (!run) return;
  const auto meaning = meaning_of_close();
  if (run && !meaning) end_run();
  on_open = meaning.value_or(Reopen::resume);
}

// What the next open will be; nothing when the run is over.
std::optional<Engine::Impl::Reopen> Engine::Impl::meaning_of_close() {
  if (config.on_reopen == OnReopen::continue_) {
    return player.nothing_left() ? std::nullopt : std::optional(Reopen::resume);
  }
  if (config.on_reopen == OnReopen::automatic) {
    const bool ahead = player.open_ahead();
    if (ahead && player.at_recorded_reopen()) return Reopen::next_open;
    if ((ahead && !exchanged) || player.just_passed_open(now)) return Reopen::restart_session;
    settle(Player::Lost::all);
    return ahead ? std::optional(Reopen::next_open) : std::nullopt;
  }
  settle(Player::Lost::all);
  return std::nullopt;
}

void Engine::Impl::settle(Player::Lost lost) {
  while (run) {
    const auto fault = player.settle(now, lost);
    if (!fault) return stop_if_damaged();
    tell_fault(*fault);
  }
}

ReplayActions Engine::Impl::advance(Instant at, std::size_t max_bytes) {
  now = std::max(now, at);
  dirty = false;
  if (!run && driver_open && std::exchange(writing_ended, false)) pending.hang_up = true;
  // The end of a run is told alone, so that nothing of the next run is mixed in.
  if (pending.run_ended || !run) {
    dirty = run.has_value();
    return std::exchange(pending, {});
  }
  ReplayActions out;
  if (driver_open) play(max_bytes, out);
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
  }
  if (!blocked && (!player.wake() || *player.wake() > now)) was_blocked = false;
  stop_if_damaged();
  if (run && writing_ended && !blocked && (player.session_played() || !player.wake())) {
    writing_ended = false;
    out.hang_up = true;
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
  const Schedule::Totals passed = player.schedule().drain();
  const auto unsent = matcher.first_unsent();
  RunReport report = run->report(config, now, unsent.has_value() || matcher.matched() < passed.writes);
  report.to_driver_of = passed.reads;
  report.from_driver_of = passed.writes;
  report.from_driver_matched = matcher.matched();
  if (unsent) {
    report.next_expected = unsent->bytes;
    report.next_expected_offset = unsent->offset;
    report.next_expected_tape = unsent->at;
  }
  pending.run_ended = std::move(report);
  run.reset();
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
  if (run->mismatches() < kMostHints) {
    mismatch.hint = find_hint(writes, mismatch.tape_offset, got);
    matcher.restore_source();
  }
  tell(std::move(mismatch));
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
  tell(std::move(mismatch));
}

void Engine::Impl::tell(Mismatch mismatch) {
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

std::optional<RunReport> Engine::Impl::finish(Instant at) {
  now = std::max(now, at);
  dirty = false;
  if (driver_open) settle(Player::Lost::all);
  if (run) end_run();
  return std::exchange(pending, {}).run_ended;
}

Engine::Engine(const ReplayConfig& config, const TapeFacts& facts, RecordSource& schedule,
               RecordSource& writes)
    : impl_(std::make_unique<Impl>(config, facts, schedule, writes)) {}

Engine::~Engine() = default;

void Engine::on_open(Instant now) { impl_->open(now); }

void Engine::on_write(Instant now, ByteView data) { impl_->write(now, data); }

void Engine::on_writing_ended(Instant now) {
  impl_->now = now;
  impl_->dirty = impl_->writing_ended = true;
}

void Engine::on_close(Instant now) { impl_->close(now); }

std::optional<Instant> Engine::next_deadline() const {
  if (impl_->dirty) return impl_->now;
  if (!impl_->run || !impl_->driver_open) return std::nullopt;
  return impl_->player.wake();
}

ReplayActions Engine::advance(Instant now, std::size_t max_bytes) { return impl_->advance(now, max_bytes); }

std::optional<RunReport> Engine::finish(Instant now) { return impl_->finish(now); }

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
