#include "libport/replay/matcher.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kMaxQueued = 4096;  // completions, arrivals
constexpr std::size_t kContextBytes = 32;
}  // namespace

void Matcher::rewind() {
  stream_.rewind();
  comparing_ = true;
  arrival_open_ = false;
  open_ = goes_on_ = false;
  surplus_ = false;
  comparison_.begin();
  written_ = 0;
  matched_ = 0;
  arrived_ = 0;
  completions_.clear();
  left_outs_.clear();
  arrivals_.clear();
  recent_.clear();
  skipped_.reset();
  next_gap_ = most_gaps_ = 0;
  realigned_ = false;
  search_.end();
}

Matcher::Step Matcher::write(Instant now, ByteView data, std::optional<TapeTime> until) {
  if (data.empty() && !goes_on_) return {};
  Step step;
  if (!comparing_) {
    count(now, data.size());
    step.used = data.size();
  } else if (surplus_ && same_arrival(now)) {
    step.used = data.size();
  } else {
    surplus_ = false;
    step = compare(now, data, until);
  }
  if (step.used == 0 && (step.outcome == Outcome::later || step.outcome == Outcome::gone)) return step;
  written_ += step.used;
  if (!data.empty()) {
    last_write_ = now;
    arrival_open_ = true;
  }
  if (step.outcome == Outcome::block) complete({position(), written_, now});
  return step;
}

Matcher::Step Matcher::compare(Instant now, ByteView data, std::optional<TapeTime> until) {
  Step step;
  while (step.used < data.size() || goes_on_) {
    const WriteStream::State state = look();
    const bool ended = state == WriteStream::State::end;
    if (state == WriteStream::State::later) {
      step.outcome = Outcome::later;
      return step;
    }
    if (until && (ended || stream_.front_at() >= *until)) {
      step.outcome = Outcome::gone;
      return step;
    }
    reach_gaps(ended);
    const ByteView rest = data.subspan(step.used);
    if (search_.active()) {
      if (search(now, rest, ended, step)) return step;
      continue;
    }
    if (ended) {
      if (compare_beyond(rest, step)) continue;
      step.outcome = Outcome::extra;
      return step;
    }
    const Expectation::Held held = hold(rest);
    const bool piece_done = held.recorded == stream_.front().size();
    const bool block_done = use(held, rest.first(held.came), step);
    if (held.differs) {
      step.outcome = Outcome::differs;
      return step;
    }
    if (block_done) {
      step.outcome = Outcome::block;
      return step;
    }
    if (piece_done) complete({stream_.position(), written_ + step.used, now});
  }
  return step;
}

WriteStream::State Matcher::look() {
  const WriteStream::State state = stream_.look();
  if (comparison_.plain() || state != WriteStream::State::bytes) return state;
  return stream_.look_ahead(comparison_.reach());
}

Expectation::Held Matcher::hold(ByteView came) {
  if (comparison_.plain()) return Expectation::exactly(stream_.front(), came);
  const Expectation::Held held = comparison_.hold(stream_.stretch(), came);
  goes_on_ = held.goes_on && !held.differs;
  open_ = held.recorded == 0 && !held.differs && !goes_on_;
  return held;
}

bool Matcher::use(const Expectation::Held& held, ByteView came, Step& step) {
  const bool block_done = held.recorded == stream_.front().size() && stream_.front_ends_block();
  step.at = stream_.front_at();
  step.block_size = stream_.stretch().in_block + held.recorded;
  if (replies_ != nullptr) replies_->asked({position(), stream_.front().first(held.recorded), came});
  remember(came);
  left_outs_.note(position(), position() + held.recorded, held.left_out);
  stream_.consume(held.recorded);
  step.used += came.size();
  matched_ += held.recorded;
  return block_done;
}

Matcher::Step Matcher::pause() {
  Step step;
  while (open_ || goes_on_) {
    const WriteStream::State state = look();
    if (state != WriteStream::State::bytes) {
      if (state == WriteStream::State::later) step.outcome = Outcome::later;
      if (state == WriteStream::State::end) {
        if (goes_on_) step.outcome = Outcome::extra;
        open_ = goes_on_ = false;
      }
      break;
    }
    const Expectation::Held held = hold({});
    const bool piece_done = held.recorded == stream_.front().size();
    const bool block_done = use(held, {}, step);
    open_ = held.recorded > 0 && !block_done && !held.differs;
    if (piece_done) complete({position(), written_, last_write_});
    if (held.differs) step.outcome = Outcome::differs;
    if (block_done) step.outcome = Outcome::block;
    if (block_done || held.differs) break;
  }
  return step;
}

Matcher::Step Matcher::end_session() {
  Step step;
  open_ = goes_on_ = false;
  while (comparing_ && !comparison_.plain() && !search_.active() && look() == WriteStream::State::bytes) {
    const Expectation::Held held = comparison_.at_end(stream_.stretch());
    const bool piece_done = held.recorded == stream_.front().size();
    use(held, {}, step);
    if (piece_done) complete({position(), written_, last_write_});
    if (held.differs) {
      step.outcome = Outcome::differs;
      return step;
    }
    if (held.recorded == 0) break;
  }
  const bool began = !comparison_.memory().came.empty() && comparison_.memory().recorded.empty();
  if (comparing_ && began && stream_.look() == WriteStream::State::end &&
      comparison_.hold_beyond({}).differs) {
    step.outcome = Outcome::extra;
    return step;
  }
  comparison_.end_session();
  return step;
}

// Behind the tape's end. True where what came may come there.
bool Matcher::compare_beyond(ByteView rest, Step& step) {
  goes_on_ = false;
  const Expectation::Held held = comparison_.hold_beyond(rest);
  if (replies_ != nullptr && held.came > 0) replies_->asked({position(), {}, rest.first(held.came)});
  remember(rest.first(held.came));
  step.used += held.came;
  return !held.differs && (held.came > 0 || rest.empty());
}

// The gaps that end before the next recorded byte.
void Matcher::reach_gaps(bool ended) {
  const bool realigned = std::exchange(realigned_, false);
  while (gaps_ != nullptr && next_gap_ < gaps_->size() &&
         (ended || stream_.front_at() >= (*gaps_)[next_gap_].to)) {
    const TapeGap& gap = (*gaps_)[next_gap_++];
    if (gap.bytes == 0 || realigned) continue;
    search_.begin(gap.bytes);
    comparison_.begin();
  }
}

// Behind a gap: the next byte of the driver. True where there is something to tell.
bool Matcher::search(Instant now, ByteView rest, bool ended, Step& step) {
  const std::optional<Byte> front = ended ? std::nullopt : std::optional(stream_.front().front());
  switch (search_.take(rest.front(), front)) {
    case GapSearch::Found::retry:
      return false;
    case GapSearch::Found::too_many:
      step.outcome = ended ? Outcome::extra : Outcome::differs;
      return true;
    case GapSearch::Found::known:
    case GapSearch::Found::skipped:
      ++step.used;
      return false;
    case GapSearch::Found::front:
      break;
  }
  const bool piece_done = stream_.front().size() == 1;
  const bool block_done = piece_done && stream_.front_ends_block();
  step.at = stream_.front_at();
  step.block_size = stream_.stretch().in_block + 1;
  remember(rest.first(1));
  stream_.consume(1);
  ++step.used;
  ++matched_;
  if (block_done) {
    step.outcome = Outcome::block;
    return true;
  }
  if (piece_done) complete({stream_.position(), written_ + step.used, now});
  return false;
}

void Matcher::complete(const Completion& done) {
  const bool full = completions_.size() >= kMaxQueued;
  const bool merge = !completions_.empty() && (full || completions_.back().real == done.real);
  if (merge) {
    completions_.back() = done;
  } else {
    completions_.push_back(done);
  }
}

void Matcher::remember(ByteView matched) {
  const ByteView tail = matched.last(std::min(matched.size(), kContextBytes));
  recent_.insert(recent_.end(), tail.begin(), tail.end());
  if (recent_.size() > kContextBytes) {
    recent_.erase(recent_.begin(), recent_.end() - static_cast<std::ptrdiff_t>(kContextBytes));
  }
}

bool Matcher::same_arrival(Instant now) const {
  return arrival_open_ && now < clock_.silent(last_write_, arrival_gap_);
}

void Matcher::diverge() { comparing_ = open_ = goes_on_ = false; }

void Matcher::count(Instant now, std::size_t bytes) {
  arrived_ += bytes;
  if (!arrivals_.empty() && (same_arrival(now) || arrivals_.size() >= kMaxQueued)) {
    arrivals_.back().bytes += bytes;
    arrivals_.back().real = now;
  } else {
    arrivals_.push_back({bytes, now});
  }
}

void Matcher::answered() {
  arrival_open_ = false;
  surplus_ = false;
}

std::optional<Matcher::Completion> Matcher::completion(std::uint64_t tape_end) {
  if (position() < tape_end) return std::nullopt;
  while (!completions_.empty() && completions_.front().tape_end < tape_end) completions_.pop_front();
  if (completions_.empty()) return Completion{tape_end, written_, last_write_};
  Completion done = completions_.front();
  done.driver_end -= std::min(done.driver_end, done.tape_end - tape_end);
  done.tape_end = tape_end;
  return done;
}

std::optional<Instant> Matcher::take(std::uint64_t tape_end) {
  if (comparing_ || tape_end <= position()) return std::nullopt;
  const std::uint64_t needed = tape_end - position();
  if (arrived_ < needed) return std::nullopt;
  std::uint64_t taken = 0;
  Instant real{};
  while (taken < needed) {
    taken += arrivals_.front().bytes;
    real = arrivals_.front().real;
    arrivals_.pop_front();
  }
  arrived_ -= taken;
  stream_.skip_to(tape_end);
  if (arrivals_.empty()) compare_again();
  return real;
}

void Matcher::realign(std::uint64_t tape_end) {
  note_skipped(tape_end);
  stream_.skip_to(tape_end);
  compare_again();
}

void Matcher::realign_to_time(TapeTime at) {
  stream_.skip_before(at);
  compare_again();
}

void Matcher::go_to(TapeTime at) {
  if (stream_.passed(at)) {
    stream_.rewind();
    most_gaps_ = std::max(most_gaps_, std::exchange(next_gap_, 0));
  }
  stream_.skip_before(at);
  compare_again();
  surplus_ = realigned_ = false;
  while (gaps_ != nullptr && next_gap_ < gaps_->size() && (*gaps_)[next_gap_].to <= at) ++next_gap_;
}

void Matcher::compare_again() {
  arrivals_.clear();
  arrived_ = 0;
  completions_.clear();
  left_outs_.clear();
  recent_.clear();
  comparing_ = true;
  open_ = goes_on_ = false;
  comparison_.begin();
  surplus_ = true;
  realigned_ = true;
  search_.end();
}

void Matcher::note_skipped(std::uint64_t tape_end) {
  if (comparing_ && !skipped_ && position() < tape_end) skipped_ = first_unsent();
}

std::optional<bool> Matcher::at_end() {
  const WriteStream::State state = stream_.look();
  if (state == WriteStream::State::later) return std::nullopt;
  return state == WriteStream::State::end;
}

std::optional<bool> Matcher::any_unsent() {
  if (skipped_) return true;
  const std::optional<bool> ended = at_end();
  if (!ended) return std::nullopt;
  return !*ended;
}

std::optional<Matcher::Unsent> Matcher::first_unsent() {
  if (skipped_) return skipped_;
  if (at_end().value_or(true)) return std::nullopt;
  const std::uint64_t block_after = stream_.front().size();
  const ByteView before = stream_.stretch().before;
  Bytes sent(before.begin(), before.end());
  return Unsent{position(), stream_.front_at(), stream_.peek(Mismatch::kMostShown), std::move(sent),
                block_after};
}

Mismatch Matcher::describe(ByteView got) {
  Mismatch mismatch;
  const bool beyond = at_end().value_or(false) && comparison_.memory().blame.recorded == 0;
  mismatch.kind = beyond ? MismatchKind::extra : MismatchKind::data;
  mismatch.offset = written_;
  mismatch.tape_offset = position();
  mismatch.tape = stream_.front_at();
  mismatch.expected = stream_.peek(Mismatch::kMostShown);
  const ByteView shown = got.first(std::min(got.size(), Mismatch::kMostShown));
  mismatch.got.assign(shown.begin(), shown.end());
  const ByteView kept = got.first(std::min(got.size(), Mismatch::kMostCame));
  mismatch.came.assign(kept.begin(), kept.end());
  mismatch.before = recent_;
  if (mismatch.kind == MismatchKind::data && !stream_.front().empty()) {
    mismatch.block_before = stream_.stretch().in_block;
    mismatch.block_after = stream_.front().size();
  }
  begin_where_blamed(mismatch);
  return mismatch;
}

// A difference that showed only behind the bytes that it is about begins with them.
void Matcher::begin_where_blamed(Mismatch& mismatch) const {
  const Expectation::Memory& memory = comparison_.memory();
  const std::size_t came = std::min(memory.blame.came, memory.came.size());
  const std::size_t recorded = std::min(memory.blame.recorded, memory.recorded.size());
  mismatch.why = memory.blame.why;
  mismatch.offset -= std::min<std::uint64_t>(came, mismatch.offset);
  mismatch.tape_offset -= std::min<std::uint64_t>(recorded, mismatch.tape_offset);
  const auto blamed = memory.came.end() - static_cast<std::ptrdiff_t>(came);
  mismatch.got.insert(mismatch.got.begin(), blamed, memory.came.end());
  mismatch.came.insert(mismatch.came.begin(), blamed, memory.came.end());
  mismatch.expected.insert(mismatch.expected.begin(),
                           memory.recorded.end() - static_cast<std::ptrdiff_t>(recorded),
                           memory.recorded.end());
  mismatch.got.resize(std::min(mismatch.got.size(), Mismatch::kMostShown));
  mismatch.came.resize(std::min(mismatch.came.size(), Mismatch::kMostCame));
  mismatch.expected.resize(std::min(mismatch.expected.size(), Mismatch::kMostShown));
  mismatch.before.resize(mismatch.before.size() - std::min(mismatch.before.size(), came));
  mismatch.block_before -= std::min<std::uint64_t>(recorded, mismatch.block_before);
  mismatch.block_after += recorded;
}

}  // namespace porttape
