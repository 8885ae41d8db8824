#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/answer_source.hpp"
#include "libport/replay/arrivals.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/gap_cuts.hpp"
#include "libport/replay/pieces.hpp"
#include "libport/replay/rate_changes.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/replies.hpp"
#include "libport/replay/request_index.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// Plays answers in the order in which they were asked for, each timed from its own request and none before
// the one before has been played. Refers to all that it is given, which must outlive it. `pieces` is of the
// line, whoever else speaks on it.
class AnswerPlayer {
 public:
  static constexpr std::size_t kMostWaiting = 65536;

  // One that the driver has asked for.
  struct Asked {
    std::uint32_t exchange = 0;
    Instant at{};             // when its request was complete
    std::uint64_t again = 0;  // how often it was asked for before
    Bytes request{};          // what the driver wrote; kept where answers follow it
  };

  // `replies`: null where answers are as recorded.
  AnswerPlayer(const ReplayConfig& config, bool bursts, bool half_closes, const RequestIndex& index,
               AnswerSource& answers, Budget& budget, Pieces& pieces, const ReplayClock& clock,
               const Expectation* expectation, Replies* replies);

  // Nothing comes where the device has ended its sending in this session.
  void add(Asked asked) {
    if (!sending_ended_) waiting_.push_back(std::move(asked));
  }
  [[nodiscard]] bool full() const { return waiting_.size() >= kMostWaiting; }
  [[nodiscard]] bool idle() const { return waiting_.empty(); }
  // Forgets what is not delivered yet.
  void drop();
  void begin_run() {
    begin_session();
    never_delivered_ = 0;
  }
  // The driver has gone: what was asked for in the last session comes no more.
  void begin_session() {
    never_delivered_ = undelivered();
    drop();
    sending_ended_ = false;
  }
  // Bytes of answers that were asked for in this run and not delivered, but for those that a flush of the
  // driver's dropped, or that had to wait behind the end of the device's sending.
  [[nodiscard]] std::uint64_t undelivered() const;
  // The driver is told that the device sends no more in this session, by an answer's end or else.
  void end_sending() {
    drop();
    sending_ended_ = true;
  }
  // The driver throws away what is due and was not delivered; true when it is done.
  bool flush(Instant now);

  // Delivers what is due into `out`, of at most `max_bytes`.
  void play(Instant now, std::size_t max_bytes, bool blocked, ReplayActions& out);
  // When play() is to be called next; nothing: when something has happened.
  [[nodiscard]] std::optional<Instant> wake() const { return wake_; }
  void wake_at(Instant now) { wake_ = now; }
  // When the first of what the last play() delivered had been due.
  [[nodiscard]] const std::optional<Instant>& delivered_due() const { return delivered_due_; }

  // From `now` on; the clock has it already.
  void set_rate(double rate, Instant now) {
    rates_.add(timeline_.rate(), now);
    timeline_.set_rate(rate, now);
  }
  [[nodiscard]] bool holds_piece() const { return holds_piece_; }
  // A part of a recorded read was delivered, and the rest was not.
  [[nodiscard]] bool inside_read() const {
    if (!begun_ || left_ == 0 || !head_ || error_ || taken_ == 0) return false;
    return taken_ < head_->data.size() || !head_->last_piece();
  }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }

 private:
  struct Turn {
    Instant now{};
    std::size_t max_bytes = 0;
    bool blocked = false;
    ReplayActions* out = nullptr;  // null: what is due is dropped
  };

  bool step(const Turn& turn);
  void begin_answer();
  void tell_asked();
  bool play_read(const Turn& turn);
  void deliver(const Turn& turn, ByteView piece, Instant due);
  bool end_answer(const Turn& turn);
  void append(ReplayActions& out, ByteView bytes, bool goes_on);
  const Record* head();
  [[nodiscard]] const RequestIndex::Exchange& exchange() const {
    return index_.exchange(waiting_.front().exchange);
  }
  [[nodiscard]] Instant due(TapeTime at) const;  // that cuts_ has reached
  bool wait(std::optional<Instant> until) {
    wake_ = until;
    return false;
  }

  bool timed_;
  bool half_closes_;
  bool sending_ended_ = false;
  const RequestIndex& index_;
  AnswerSource& answers_;
  Budget& budget_;
  const ReplayClock& clock_;
  const Expectation* expectation_;
  Replies* replies_;
  Arrivals arrivals_;
  Pieces& pieces_;

  std::deque<Asked> waiting_;
  bool begun_ = false;      // the front one
  std::uint64_t left_ = 0;  // bytes of its answer
  std::uint64_t records_ = 0;
  std::optional<Record> head_;
  std::size_t taken_ = 0;  // of the head
  GapCuts cuts_;           // of the front answer's times
  RateChanges rates_;
  Timeline timeline_;
  Instant floor_{};
  std::optional<Instant> wake_;
  std::optional<Instant> delivered_due_;
  bool holds_piece_ = false;
  std::uint64_t never_delivered_ = 0;  // undelivered() of the sessions before
  bool delivers_ = false;              // has, in this play()
  std::optional<Error> error_;
};

}  // namespace porttape
