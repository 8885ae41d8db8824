// What the engine is told, worked on in turn as far as the budget goes.

#include <algorithm>
#include <utility>

#include "libport/replay/engine_impl.hpp"

namespace porttape {

void Engine::Impl::tell(Input input) {
  now = input.at;
  dirty = true;
  budget.refill();
  inputs.push_back(std::move(input));
  work();
}

// As tell(), without a copy of what can be looked at now.
void Engine::Impl::tell_write(Instant at, ByteView data) {
  now = at;
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
  while (!inputs.empty() && !pending.run_ended) {
    now = inputs.front().at;
    if (!work_on(inputs.front())) break;
    inputs.pop_front();
  }
  now = latest;
}

// True when it is done with.
bool Engine::Impl::work_on(Input& input) {
  switch (input.kind) {
    case Input::Kind::open:
      return open(input);
    case Input::Kind::write: {
      const std::size_t used =
          write(ByteView(input.data).subspan(input.used), std::exchange(input.begun, true));
      input.used += used;
      backlog -= used;
      return input.used == input.data.size();
    }
    case Input::Kind::writing_ended:
      writing_ended = true;
      return true;
    case Input::Kind::flush:
      return flush();
    case Input::Kind::close:
      return close(input);
    case Input::Kind::finish:
      break;
  }
  return finish();
}

bool Engine::Impl::switching() const {
  return std::any_of(inputs.begin(), inputs.end(), [](const Input& input) {
    return input.kind == Input::Kind::open || input.kind == Input::Kind::close ||
           input.kind == Input::Kind::finish;
  });
}

bool Engine::Impl::open(Input& input) {
  if (!input.begun) {
    if (driver_open && run) return true;
    input.begun = driver_open = true;
    exchanged = writing_ended = device_gone = false;
    if (!run && any_run && config.on_reopen == OnReopen::continue_) {
      pending.hang_up = pending.hang_up || config.at_end == AtEnd::hangup;
      return true;
    }
    if (!run) {
      on_open = Reopen::resume;
      begin_run();
    } else if (on_open == Reopen::restart_session) {
      player.restart_session(now);
    } else if (on_open == Reopen::next_open) {
      player.continue_at_next_open(now);
    } else {
      resuming = true;
    }
  }
  if (run && !reopen()) return false;
  stop_if_damaged();
  return true;
}

// Goes to where the new session plays from. True once it is there.
bool Engine::Impl::reopen() {
  if (resuming) {
    if (!settle()) return false;
    resuming = false;
    if (!run) return true;
    player.resume(now);
  }
  if (!player.seek()) return false;
  if (on_open == Reopen::next_open) {
    const std::uint64_t there = player.schedule().passed().writes;
    if (can_realign() && (!matcher.comparing() || matcher.position() < there)) matcher.realign(there);
  }
  return true;
}

bool Engine::Impl::close(Input& input) {
  driver_open = false;
  if (!run) return true;
  if (!input.begun) {
    closing = meaning_of_close();
    if (!closing.known) return false;
    input.begun = true;
  }
  if (closing.judge && !judge()) return false;
  if (run && !closing.next) end_run();
  on_open = closing.next.value_or(Reopen::resume);
  return true;
}

Engine::Impl::Close Engine::Impl::meaning_of_close() {
  if (config.on_reopen == OnReopen::continue_) {
    const std::optional<bool> over = player.sessions().nothing_left();
    if (!over) return {};
    return {.known = true, .next = *over ? std::nullopt : std::optional(Reopen::resume)};
  }
  if (config.on_reopen != OnReopen::automatic) return {.known = true, .judge = true};
  const bool ahead = player.sessions().open_ahead();
  const std::optional<bool> at_reopen = ahead ? player.sessions().at_recorded_reopen() : false;
  if (!at_reopen) return {};
  if (*at_reopen) return {.known = true, .next = Reopen::next_open};
  const std::optional<bool> late = player.sessions().just_passed_open(now);
  if (!late) return {};
  if ((ahead && !exchanged) || *late) return {.known = true, .next = Reopen::restart_session};
  return {.known = true, .judge = true, .next = ahead ? std::optional(Reopen::next_open) : std::nullopt};
}

bool Engine::Impl::judge() {
  while (run) {
    const Player::Settled judged = player.judge(now);
    if (!tell_settled(judged)) continue;
    return judged.done;
  }
  return true;
}

bool Engine::Impl::settle() {
  while (run) {
    const Player::Settled settled = player.settle(now);
    if (!tell_settled(settled)) continue;
    return settled.done;
  }
  return true;
}

bool Engine::Impl::flush() {
  while (run && driver_open) {
    const Player::Settled flushed = player.flush(now);
    if (!tell_settled(flushed)) continue;
    return flushed.done;
  }
  return true;
}

// False where there was a fault, so that there may be more.
bool Engine::Impl::tell_settled(const Player::Settled& settled) {
  if (settled.fault) {
    tell_fault(*settled.fault);
    return false;
  }
  if (settled.done) stop_if_damaged();
  return true;
}

bool Engine::Impl::finish() {
  if (driver_open && run && !judge()) return false;
  if (run) end_run();
  return finished = true;
}

void Engine::Impl::give_up(Instant at) {
  now = std::max(now, at);
  dirty = true;
  budget.refill();
  inputs.clear();
  backlog = 0;
  if (run) end_run();
  finished = true;
}

}  // namespace porttape
