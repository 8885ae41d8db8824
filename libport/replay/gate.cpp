#include "libport/replay/gate.hpp"

#include <algorithm>

namespace porttape {

void Gate::begin_run() {
  begin_session(0);
  lenient_ = always_lenient_;
  lenient_since_ = {};
}

void Gate::begin_session(std::uint64_t writes) {
  pending_ = false;
  begin_ = writes;
  end_ = writes;
  at_ = {};
  gap_ = false;
}

void Gate::add_write(std::uint64_t end, TapeTime at) {
  pending_ = true;
  end_ = end;
  at_ = at;
}

void Gate::add_gap(TapeTime at, bool may_miss) {
  gap_ = may_miss;
  if (!pending_) at_ = at;
}

void Gate::pass(std::uint64_t end, TapeTime at, Instant real) {
  end_ = end;
  opened(at, real, real);
}

Gate::Answer Gate::open(Instant now, TapeTime next_at) {
  if (!pending_ && !gap_) return {.open = true};
  if (const auto done = pending_ ? matcher_.completion(end_) : std::nullopt) {
    opened(at_, done->real, done->real);
    return {.open = true};
  }
  if (const auto come = pending_ ? matcher_.take(end_) : std::nullopt) {
    opened(at_, *come, *come);
    return {.open = true};
  }
  if (!silence_counts() && !in_gap()) return {};
  const Silence silence = next_silence(next_at);
  if (now < silence.end) return {.until = silence.end};
  // In a gap the place is still to be found: nothing of the tape counts as asked.
  if (!gap_ && !matcher_.astray()) matcher_.realign(end_);
  if (silence.after_writing) {
    opened(at_, matcher_.last_write(), silence.end);
  } else {
    opened(next_at, silence.end, silence.end);
  }
  return {.open = true};
}

void Gate::opened(TapeTime tape, Instant real, Instant not_before) {
  pace_.go_on_from(tape, real, not_before);
  pending_ = false;
  gap_ = false;
  begin_ = end_;
}

Gate::Silence Gate::next_silence(TapeTime next_at) const {
  const Instant patience = patience_end(next_at);
  if (matcher_.touched(begin_) || matcher_.astray()) {
    const Instant quiet = pace_.clock().silent(matcher_.last_write(), quiet_);
    if (quiet <= patience) return {quiet, true};
  }
  return {patience, false};
}

// The driver gets its patience in full.
Instant Gate::patience_end(TapeTime next_at) const {
  return pace_.clock().silent(std::max(pace_.due_to_driver(next_at), lenient_since_), patience_);
}

void Gate::become_lenient(Instant now) {
  if (lenient_) return;
  lenient_ = true;
  lenient_since_ = now;
}

}  // namespace porttape
