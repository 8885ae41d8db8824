#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/replay/gap_search.hpp"
#include "libport/replay/left_outs.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/write_stream.hpp"

namespace porttape {

// Compares what the driver writes with what the tape expects, as one stream; how either side cuts it never
// matters. What of it may vary is an Expectation's to say: the bytes that go together are "as recorded".
// Decides nothing about verdicts and gates: it tells how far the driver is, when it got there, and
// where it differs.
//
// It is in one of two states. *Comparing*: every byte is held against the tape; the position is the number of
// recorded bytes it stands at. *Diverged*: the bytes are only counted, as arrivals (bytes that come in one
// write, or less than `arrival_gap` apart with no answer in between), until realign() or a take() that uses
// up all arrivals compares again.
//
// Memory is bounded: a driver far ahead of the walk has its oldest progress kept exactly and the newest
// merged, which can only make a time later.
class Matcher {
 public:
  // What became of the front of a write.
  enum class Outcome : std::uint8_t {
    taken,    // all of it is as recorded, or only counted
    block,    // a recorded block is complete
    differs,  // the byte after those used is not the recorded one
    extra,    // the tape expects nothing more
    gone,     // the device had gone (see `until`): nobody expects the rest
    later,    // the budget is spent: call again with the rest when it is refilled
  };
  struct Step {
    Outcome outcome = Outcome::taken;
    std::size_t used = 0;
    TapeTime at{};               // block: when it was recorded
    std::size_t block_size = 0;  // block
  };

  // The driver completed the tape's stream up to an offset.
  struct Completion {
    std::uint64_t tape_end = 0;
    std::uint64_t driver_end = 0;  // its own offset then
    Instant real{};
  };

  struct Unsent {
    std::uint64_t offset = 0;  // in the tape's stream
    TapeTime at{};
    Bytes bytes;
    Bytes before;                   // what of the recorded write was sent
    std::uint64_t block_after = 0;  // so many bytes are left of it
  };

  // What the clock is moved by hand is no pause of the driver's. `expectation`: null where nothing may vary.
  // All must outlive it.
  Matcher(RecordSource& writes, Budget& budget, const ReplayClock& clock, Micros arrival_gap,
          const Expectation* expectation = nullptr)
      : stream_(writes, budget), comparison_(expectation), clock_(clock), arrival_gap_(arrival_gap) {}

  // Is told what was taken for what; must outlive it.
  void set_replies(Replies* replies) { replies_ = replies; }

  // The tape's gaps, in order; what they swallowed of the driver's bytes is no difference. Must outlive it.
  void set_gaps(const std::vector<TapeGap>& gaps) { gaps_ = &gaps; }

  // Back to the tape's start, comparing.
  void rewind();

  // Takes bytes from the front of `data` until something is to be told; call again with the rest. After
  // `differs` and `extra` the caller says diverge() first. Writes recorded `until` then or later are not
  // compared with.
  Step write(Instant now, ByteView data, std::optional<TapeTime> until = {});
  void diverge();

  // When the driver's silence ends a field that is open (see Expectation); nothing: none is.
  [[nodiscard]] std::optional<Instant> pause_due() const {
    if (goes_on_) return last_write_;
    return open_ ? std::optional(clock_.silent(last_write_, arrival_gap_)) : std::nullopt;
  }
  // The driver pauses: ends it. `block` or `later` (call again) or `differs`, as of write(); else `taken`.
  Step pause();
  // What was written already completes more of the tape: write() is to be called again, also without bytes.
  [[nodiscard]] bool goes_on() const { return goes_on_; }
  // The driver writes no more in this session: passes over what it need not have written. `differs`: what it
  // wrote last is no beginning of what was recorded.
  Step end_session();

  // The driver wrote so much that is compared elsewhere.
  void pass_over(std::size_t bytes) { written_ += bytes; }

  // Something was delivered: what the driver writes next is a new arrival.
  void answered();

  // When the driver completed the first `tape_end` recorded bytes; nothing while it has not. Ask in rising
  // order.
  std::optional<Completion> completion(std::uint64_t tape_end);

  // Whether the driver left out all recorded bytes from the one to the other. Ask in rising order.
  [[nodiscard]] Expectation::LeftOut left_out(std::uint64_t from, std::uint64_t to) {
    return left_outs_.of(from, to);
  }

  // Diverged: whether arrivals make up for the bytes from the position to `tape_end`; uses them up (an
  // arrival wholly), moves the position there and gives the time of the last one needed.
  std::optional<Instant> take(std::uint64_t tape_end);

  // Moves the position forward to `tape_end`, forgets all arrivals and compares again from there.
  void realign(std::uint64_t tape_end);
  // The same, to the first block recorded at `at` or later.
  void realign_to_time(TapeTime at);

  // The same, back too: from the first block on that was recorded at `at` or later. What lies between is
  // neither expected any more nor missing.
  void go_to(TapeTime at);

  // The last `count` bytes that were as recorded, or fewer.
  [[nodiscard]] ByteView latest(std::size_t count) const {
    return ByteView(recent_).last(std::min(count, recent_.size()));
  }
  // A data or extra mismatch at the position with `got`; run-related fields are left to the caller.
  [[nodiscard]] Mismatch describe(ByteView got);

  // The driver is in a gap: its latest bytes are none that the tape has.
  [[nodiscard]] bool astray() const { return comparing_ && search_.astray(); }
  // How many of the gaps the driver has written up to.
  [[nodiscard]] std::size_t gaps_reached() const { return std::max(next_gap_, most_gaps_); }
  [[nodiscard]] bool comparing() const { return comparing_; }
  // Whether the tape expects nothing more; nothing while that is not known.
  [[nodiscard]] std::optional<bool> at_end();
  // Whether anything came beyond the recorded offset `begin`.
  [[nodiscard]] bool touched(std::uint64_t begin) const { return position() > begin || !arrivals_.empty(); }
  [[nodiscard]] Instant last_write() const { return last_write_; }
  [[nodiscard]] std::uint64_t position() const { return stream_.position(); }
  [[nodiscard]] std::uint64_t written() const { return written_; }
  [[nodiscard]] std::uint64_t matched() const { return matched_; }
  // Whether there are recorded bytes that the driver did not send; nothing while that is not known.
  [[nodiscard]] std::optional<bool> any_unsent();
  // Some were passed over, and not because the tape was not to go on there.
  [[nodiscard]] bool any_skipped() const { return skipped_.has_value(); }
  // The first of them, as far as known.
  [[nodiscard]] std::optional<Unsent> first_unsent();
  [[nodiscard]] const std::optional<Error>& error() const { return stream_.error(); }

 private:
  struct Arrival {
    std::uint64_t bytes = 0;
    Instant real{};
  };

  Step compare(Instant now, ByteView data, std::optional<TapeTime> until);
  [[nodiscard]] Expectation::Held hold(ByteView came);
  [[nodiscard]] WriteStream::State look();
  // Moves over what hold() used. True where the block is complete.
  bool use(const Expectation::Held& held, ByteView came, Step& step);
  bool compare_beyond(ByteView rest, Step& step);
  bool search(Instant now, ByteView rest, bool ended, Step& step);
  void reach_gaps(bool ended);
  void count(Instant now, std::size_t bytes);
  void complete(const Completion& done);
  void remember(ByteView matched);
  void begin_where_blamed(Mismatch& mismatch) const;
  void note_skipped(std::uint64_t tape_end);
  void compare_again();
  [[nodiscard]] bool same_arrival(Instant now) const;

  WriteStream stream_;
  Comparison comparison_;
  Replies* replies_ = nullptr;
  const ReplayClock& clock_;
  Nanos arrival_gap_;
  bool comparing_ = true;
  bool arrival_open_ = false;  // nothing was delivered since the last write
  bool open_ = false;          // the latest bytes are of a field whose end has not shown
  bool goes_on_ = false;
  bool surplus_ = false;  // the arrival that opened the last gate may still go on
  Instant last_write_{};
  std::uint64_t written_ = 0;
  std::uint64_t matched_ = 0;
  std::uint64_t arrived_ = 0;  // sum of arrivals_
  std::deque<Completion> completions_;
  std::deque<Arrival> arrivals_;
  LeftOuts left_outs_;
  Bytes recent_;  // the last matched bytes
  std::optional<Unsent> skipped_;
  const std::vector<TapeGap>* gaps_ = nullptr;
  std::size_t next_gap_ = 0;
  std::size_t most_gaps_ = 0;  // that it came to, where it went back since
  bool realigned_ = false;     // since bytes were last compared
  GapSearch search_;
};

}  // namespace porttape
