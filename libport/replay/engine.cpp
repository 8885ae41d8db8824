#include "libport/replay/engine.hpp"

#include <algorithm>
#include <cstdint>
#include <deque>
#include <utility>

#include "libport/replay/budget.hpp"
#include "libport/replay/replay_run.hpp"

namespace porttape {

// What the engine is told, in turn, and what the driver's opens and closes mean: begins and ends runs, and
// says where on the tape each session plays from. Driven as Engine is.
//
// What it is told becomes an input, which is worked on at once as far as the budget goes and else waits, with
// all that follow it, for the next advance().
struct Engine::Impl {
  // What the driver's next open means while a run goes on.
  enum class Reopen : std::uint8_t { next_open, restart_session, next_loop, resume };

  struct Input {
    enum class Kind : std::uint8_t { open, write, writing_ended, line_ended, event, seek, close, finish };
    Kind kind = Kind::write;
    Instant at{};
    Bytes data{};          // write
    LineEvent what{};      // event
    TapeTime to{};         // seek
    std::size_t used = 0;  // of data
    // open, close: what it means is settled, and the walk is on its way; write: the run's books have it
    bool begun = false;
  };

  // What the driver's close means.
  struct Close {
    bool known = false;            // else to be asked again
    bool judge = false;            // the writes made ahead of the walk are to be judged
    std::optional<Reopen> next{};  // what its next open is; nothing when the run is over
  };

  Impl(const ReplayConfig& config, const TapeFacts& facts, const Parts& parts, RecordSource& schedule,
       RecordSource& writes)
      : run(config, facts, parts, schedule, writes, budget) {}

  void tell(Input input);
  void tell_write(Instant real, ByteView data);
  // The run's own time at a time of the caller's.
  [[nodiscard]] Instant played(Instant real) { return run.clock().played(real); }
  ReplayActions advance(Instant at, std::size_t max_bytes);
  void give_up(Instant at);

  void work();
  bool work_on(Input& input);
  bool work_on_write(Input& input);
  std::size_t write(ByteView data, bool counted);
  bool open(Input& input);
  bool line_ended();
  // No open plays the tape anew.
  [[nodiscard]] bool continues() const { return run.config().on_reopen == OnReopen::continue_; }
  void begin_open();
  bool reopen();
  bool close(Input& input);
  Close meaning_of_close();
  bool finish();
  [[nodiscard]] bool holds_piece() const { return run.goes_on() && driver_open && run.holds_piece(); }
  // Whether the line is on its way to another state: nothing is played meanwhile.
  [[nodiscard]] bool switching() const;
  // Whether something waits behind a write of the next loop that cannot wait for that loop.
  [[nodiscard]] bool cannot_wait() const;
  // Whether what waits is to be looked at again at once.
  [[nodiscard]] bool works_on() const { return !inputs.empty() && !run.awaits_next_loop(); }

  Budget budget;
  ReplayRun run;
  std::deque<Input> inputs;
  std::size_t backlog = 0;  // bytes of theirs
  Instant now{};
  bool dirty = false;  // something happened that advance() has not seen

  std::uint64_t clock_seen = 0;  // its changes that advance() has seen

  bool any_run = false;
  bool driver_open = false;
  bool ended_by_close = false;  // the last run
  bool behind_end = false;      // this session is behind the tape's end, and nothing was written in it yet
  bool resuming = false;        // the open that is worked on goes on where the walk was
  Close closing;                // the last close's
  Reopen on_open = Reopen::resume;
  bool finished = false;
};

void Engine::Impl::tell(Input input) {
  now = input.at = played(input.at);
  dirty = true;
  budget.refill();
  inputs.push_back(std::move(input));
  work();
}

// As tell(), without a copy of what can be looked at now.
void Engine::Impl::tell_write(Instant real, ByteView data) {
  const Instant at = now = played(real);
  dirty = true;
  if (data.empty()) return;
  budget.refill();
  const bool begun = inputs.empty();
  const std::size_t used = begun ? write(data, false) : 0;
  if (used == data.size()) return;
  const ByteView rest = data.subspan(used);
  inputs.push_back(
      {.kind = Input::Kind::write, .at = at, .data = Bytes(rest.begin(), rest.end()), .begun = begun});
  backlog += rest.size();
}

// On the inputs, in turn, as far as the budget goes. The end of a run is told before the next begins.
void Engine::Impl::work() {
  const Instant latest = now;
  while (!inputs.empty() && !run.pending().run_ended) {
    now = inputs.front().at;
    if (work_on(inputs.front())) {
      inputs.pop_front();
    } else if (run.awaits_next_loop() && cannot_wait()) {
      run.begin_next_loop(latest);
    } else {
      break;
    }
  }
  now = latest;
}

// A loop whose driver has gone on to the next, and then closes, is not played to its end.
bool Engine::Impl::cannot_wait() const {
  return std::any_of(inputs.begin(), inputs.end(), [](const Input& input) {
    return input.kind == Input::Kind::close || input.kind == Input::Kind::finish ||
           input.kind == Input::Kind::seek;
  });
}

// True when it is done with.
bool Engine::Impl::work_on(Input& input) {
  // All but a write is about where the walk stands.
  if (input.kind != Input::Kind::write && driver_open && run.goes_on() && !resuming && !run.player().seek())
    return false;
  switch (input.kind) {
    case Input::Kind::open:
      return open(input);
    case Input::Kind::write:
      return work_on_write(input);
    case Input::Kind::writing_ended:
      run.end_writing(now);
      return true;
    case Input::Kind::line_ended:
      return line_ended();
    case Input::Kind::event:
      if (std::holds_alternative<line::Flush>(input.what)) return !driver_open || run.flush(now);
      run.driver_did(now, input.what);
      return true;
    case Input::Kind::seek:
      run.seek(now, input.to);
      return true;
    case Input::Kind::close:
      return close(input);
    case Input::Kind::finish:
      break;
  }
  return finish();
}

// What the driver writes after the tape's end is a run of its own, which begins with the first byte.
std::size_t Engine::Impl::write(ByteView data, bool counted) {
  if (std::exchange(behind_end, false)) run.begin_behind_end(now);
  return run.write(now, data, counted);
}

bool Engine::Impl::work_on_write(Input& input) {
  const std::size_t used = write(ByteView(input.data).subspan(input.used), std::exchange(input.begun, true));
  input.used += used;
  backlog -= used;
  return input.used == input.data.size();
}

bool Engine::Impl::switching() const {
  return std::any_of(inputs.begin(), inputs.end(), [this](const Input& input) {
    return (input.kind == Input::Kind::open && !driver_open) || input.kind == Input::Kind::close ||
           input.kind == Input::Kind::finish;
  });
}

bool Engine::Impl::open(Input& input) {
  if (!input.begun) {
    if (driver_open && run.goes_on()) {
      run.line_opened(now);
      return true;
    }
    input.begun = driver_open = true;
    run.begin_session();
    if (!run.goes_on() && any_run && continues()) {
      ReplayActions& pending = run.pending();
      pending.hang_up = pending.hang_up || run.config().at_end == AtEnd::hangup;
      behind_end = ended_by_close && !pending.hang_up;
      return true;
    }
    begin_open();
  }
  if (run.goes_on() && !reopen()) return false;
  run.stop_if_damaged(now);
  return true;
}

bool Engine::Impl::line_ended() {
  if (!run.goes_on()) return true;
  run.end_of_writes(now);
  const std::optional<bool> expected = run.line_may_end();
  if (!expected) return false;
  if (*expected) {
    run.player().line_ended(now);
  } else if (run.goes_on()) {
    run.end(now);
  }
  return true;
}

void Engine::Impl::begin_open() {
  if (!run.goes_on()) {
    on_open = Reopen::resume;
    any_run = true;
    ended_by_close = false;
    run.begin(now);
  } else if (on_open == Reopen::restart_session) {
    run.player().restart_session(now);
  } else if (on_open == Reopen::next_open) {
    run.count_session();
    run.player().continue_at_next_open(now);
  } else if (on_open == Reopen::next_loop) {
    run.count_session();
    run.begin_next_loop(now);
  } else {
    run.count_session();
    resuming = true;
  }
}

// Goes to where the new session plays from. True once it is there.
bool Engine::Impl::reopen() {
  if (resuming) {
    if (!run.settle(now)) return false;
    resuming = false;
    if (!run.goes_on()) return true;
    run.player().resume(now);
  }
  if (!run.player().seek()) return false;
  if (on_open == Reopen::next_open) run.realign_to_walk();
  return true;
}

bool Engine::Impl::close(Input& input) {
  driver_open = behind_end = false;
  run.line_went(now);
  if (!run.goes_on()) return true;
  if (!input.begun) {
    run.end_of_writes(now);
    if (!run.goes_on()) return true;
    closing = meaning_of_close();
    if (!closing.known) return false;
    input.begun = true;
  }
  if (closing.judge && !run.judge(now)) return false;
  if (run.goes_on() && !closing.next) {
    if (!run.pass_to_close()) return false;
    run.end(now, ReplayRun::EndedBy::close);
    ended_by_close = true;
  }
  on_open = closing.next.value_or(Reopen::resume);
  return true;
}

Engine::Impl::Close Engine::Impl::meaning_of_close() {
  TapeSessions& sessions = run.player().sessions();
  if (continues()) {
    const std::optional<bool> over = sessions.nothing_left();
    if (!over) return {};
    return {.known = true, .next = *over ? std::nullopt : std::optional(Reopen::resume)};
  }
  if (run.config().on_reopen != OnReopen::automatic) return {.known = true, .judge = true};
  // Between two loops a close is as a recorded one; behind one of an endless number the run may end.
  const bool more_loops = run.config().loops > 1 && !run.player().loops().is_last();
  if (run.at_loop_begin()) {
    if (run.config().loops == 0) return {.known = true};
    return {.known = true, .next = Reopen::restart_session};
  }
  if (more_loops) {
    const std::optional<bool> over = sessions.nothing_left();
    if (!over) return {};
    if (*over) return {.known = true, .judge = true, .next = Reopen::next_loop};
  }
  const bool ahead = sessions.open_ahead();
  const std::optional<bool> at_reopen = ahead ? sessions.at_recorded_reopen() : false;
  if (!at_reopen) return {};
  if (*at_reopen) return {.known = true, .next = Reopen::next_open};
  const std::optional<bool> late = sessions.just_passed_open(now);
  if (!late) return {};
  if (*late) return {.known = true, .next = Reopen::restart_session};
  if (!run.exchanged()) {
    // The tape's last session may be looked at as any other one; where it is the only one, the look is told.
    const std::optional<bool> begun_again = ahead                ? true
                                            : run.sessions() > 1 ? run.any_writes_left()
                                                                 : std::optional(false);
    if (!begun_again) return {};
    if (*begun_again) return {.known = true, .next = Reopen::restart_session};
  }
  return {.known = true, .judge = true, .next = ahead ? std::optional(Reopen::next_open) : std::nullopt};
}

bool Engine::Impl::finish() {
  run.end_of_writes(now);
  if (driver_open && run.goes_on() && !run.judge(now)) return false;
  if (run.goes_on()) run.end(now);
  return finished = true;
}

void Engine::Impl::give_up(Instant at) {
  now = std::max(now, played(at));
  dirty = true;
  budget.refill();
  inputs.clear();
  backlog = 0;
  if (run.goes_on()) run.end(now);
  finished = true;
}

ReplayActions Engine::Impl::advance(Instant at, std::size_t max_bytes) {
  budget.refill();
  work();
  now = std::max(now, played(at));
  dirty = false;
  clock_seen = run.clock().changes();
  ReplayActions& pending = run.pending();
  if (!run.goes_on() && driver_open && run.take_writing_ended()) pending.hang_up = true;
  // The end of a run is told alone, so that nothing of the next run is mixed in.
  if (pending.run_ended || !run.goes_on()) {
    dirty = run.goes_on() || !inputs.empty();
    return std::exchange(pending, {});
  }
  ReplayActions out;
  run.player().set_behind(works_on());
  if (driver_open && !switching()) run.play(now, max_bytes, out);
  dirty = dirty || works_on();
  if (pending.empty()) return out;
  out.mismatches = std::move(pending.mismatches);
  out.hang_up = out.hang_up || pending.hang_up;
  out.run_ended = std::move(pending.run_ended);
  out.exit = pending.exit;
  pending = {};
  return out;
}

Engine::Engine(const ReplayConfig& config, const TapeFacts& facts, RecordSource& schedule,
               RecordSource& writes, const Parts& parts)
    : impl_(std::make_unique<Impl>(config, facts, parts, schedule, writes)) {}

Engine::~Engine() = default;

void Engine::on_open(Instant now) { impl_->tell({.kind = Impl::Input::Kind::open, .at = now}); }
void Engine::on_write(Instant now, ByteView data) { impl_->tell_write(now, data); }
void Engine::on_writing_ended(Instant now) {
  impl_->tell({.kind = Impl::Input::Kind::writing_ended, .at = now});
}
void Engine::on_event(Instant now, const LineEvent& event) {
  impl_->tell({.kind = Impl::Input::Kind::event, .at = now, .what = event});
}
void Engine::show_signals(bool on) { impl_->run.show_signals(on); }
void Engine::on_close(Instant now) { impl_->tell({.kind = Impl::Input::Kind::close, .at = now}); }
void Engine::on_line_ended(Instant now) { impl_->tell({.kind = Impl::Input::Kind::line_ended, .at = now}); }
void Engine::finish(Instant now) { impl_->tell({.kind = Impl::Input::Kind::finish, .at = now}); }

bool Engine::finished() const { return impl_->finished; }
void Engine::give_up(Instant now) { impl_->give_up(now); }
std::size_t Engine::backlog() const { return impl_->backlog; }

std::optional<Instant> Engine::next_deadline() const {
  const ReplayClock& clock = impl_->run.clock();
  if (impl_->dirty || impl_->clock_seen != clock.changes()) return clock.real(impl_->now);
  if (!impl_->run.goes_on() || !impl_->driver_open) return std::nullopt;
  const std::optional<Instant> wake = impl_->run.wake();
  return wake ? clock.real(*wake) : std::nullopt;
}

void Engine::stand(Instant now, bool on) {
  impl_->run.stand(now, on);
  impl_->dirty = true;
}

void Engine::step(Instant now, std::uint64_t exchanges) {
  impl_->now = std::max(impl_->now, impl_->played(now));
  impl_->run.step(exchanges);
  impl_->dirty = true;
}

void Engine::seek(Instant now, TapeTime to) {
  impl_->tell({.kind = Impl::Input::Kind::seek, .at = now, .to = to});
}

void Engine::set_rate(Instant now, double rate) {
  impl_->now = std::max(impl_->now, impl_->played(now));
  impl_->run.set_rate(impl_->now, rate);
  impl_->dirty = true;
}

Engine::Playing Engine::playing(Instant now) {
  ReplayRun& run = impl_->run;
  Playing playing{.stands = run.clock().stands(), .rate = run.clock().rate()};
  if (!run.goes_on()) return playing;
  playing.position = run.player().position(std::max(impl_->now, impl_->played(now)));
  playing.loop = run.player().loops().number();
  return playing;
}

ReplayActions Engine::advance(Instant now, std::size_t max_bytes) { return impl_->advance(now, max_bytes); }

std::optional<Engine::Unsent> Engine::first_unsent() const {
  const auto unsent = impl_->run.first_unsent();
  if (!unsent) return std::nullopt;
  return Unsent{unsent->offset, unsent->at, unsent->bytes, impl_->run.player().due_after_last(unsent->at)};
}

std::optional<bool> Engine::line_may_end() {
  impl_->budget.refill();
  return impl_->inputs.empty() ? impl_->run.line_may_end() : std::nullopt;
}

bool Engine::holds_piece() const { return impl_->holds_piece(); }

void Engine::on_taken(Instant now) {
  impl_->now = std::max(impl_->now, impl_->played(now));
  impl_->run.taken(impl_->now);
  impl_->dirty = true;
}

void Engine::set_blocked(bool blocked) {
  impl_->run.set_blocked(blocked);
  impl_->dirty = true;
}

}  // namespace porttape
