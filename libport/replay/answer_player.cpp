#include "libport/replay/answer_player.hpp"

#include <algorithm>

namespace porttape {

AnswerPlayer::AnswerPlayer(const ReplayConfig& config, bool bursts, bool half_closes,
                           const RequestIndex& index, AnswerSource& answers, Budget& budget, Pieces& pieces,
                           const ReplayClock& clock, const Expectation* expectation, Replies* replies)
    : timed_(config.timing != Timing::none),
      half_closes_(half_closes),
      index_(index),
      answers_(answers),
      budget_(budget),
      clock_(clock),
      expectation_(expectation),
      replies_(replies),
      arrivals_(bursts, config.burst_gap),
      pieces_(pieces),
      cuts_(config.max_gap),
      timeline_(clock.rate()) {}

void AnswerPlayer::drop() {
  waiting_.clear();
  begun_ = false;
  wake_.reset();
  holds_piece_ = false;
}

std::uint64_t AnswerPlayer::undelivered() const {
  std::uint64_t bytes = never_delivered_;
  for (std::size_t i = 0; i < waiting_.size(); ++i)
    bytes += i == 0 && begun_ ? left_ : index_.exchange(waiting_[i].exchange).answer_size;
  return bytes;
}

bool AnswerPlayer::flush(Instant now) {
  while (!budget_.spent() && step({.now = now})) {
  }
  return !budget_.spent();
}

void AnswerPlayer::play(Instant now, std::size_t max_bytes, bool blocked, ReplayActions& out) {
  delivered_due_.reset();
  holds_piece_ = false;
  wake_.reset();
  delivers_ = false;
  while (step({now, max_bytes, blocked, &out})) {
    if (budget_.spent()) {
      wake_ = now;
      return;
    }
  }
}

// False when something is to be waited for.
bool AnswerPlayer::step(const Turn& turn) {
  if (waiting_.empty() || error_) return wait(std::nullopt);
  if (!begun_) begin_answer();
  if (left_ > 0) return play_read(turn);
  return end_answer(turn);
}

void AnswerPlayer::begin_answer() {
  const RequestIndex::Exchange& asked = exchange();
  begun_ = true;
  left_ = asked.answer_size;
  head_.reset();
  arrivals_.rewind();
  cuts_.begin(asked.asked);
  timeline_ = rates_.timeline_from(asked.asked, waiting_.front().at, clock_.rate());
  floor_ = std::max(floor_, waiting_.front().at);
  if (replies_ != nullptr) tell_asked();
  if (left_ == 0) return;
  if (auto there = answers_.seek(asked.file_offset, asked.reads); !there) error_ = there.error();
}

// What of the request goes with what of the recorded one.
void AnswerPlayer::tell_asked() {
  const Asked& asked = waiting_.front();
  const std::size_t size = index_.request(asked.exchange).size();
  Comparison comparison(expectation_);
  std::size_t used = 0;
  std::size_t came = 0;
  while (used < size) {
    const Expectation::Stretch stretch = index_.stretch(asked.exchange, used);
    const ByteView rest = ByteView(asked.request).subspan(came);
    const Expectation::Held held = comparison.hold(stretch, rest);
    replies_->asked({stretch.offset, stretch.bytes.first(held.recorded), rest.first(held.came)});
    if (held.differs || (held.recorded == 0 && held.came == 0)) return;
    used += held.recorded;
    came += held.came;
  }
}

Instant AnswerPlayer::due(TapeTime at) const {
  return timed_ ? std::max(floor_, timeline_.real(cuts_.cut(at))) : floor_;
}

const Record* AnswerPlayer::head() {
  while (!error_ && (!head_ || taken_ == head_->data.size())) {
    if (budget_.spent()) return nullptr;
    auto record = answers_.next();
    if (!record) {
      error_ = record.error();
    } else if (!*record) {
      error_ = make_error(Errc::io, "the tape became shorter while it was read");
    } else {
      head_ = **record;
      cuts_.reach(head_->at);
      taken_ = 0;
      ++records_;
      budget_.spend(head_->data.size());
    }
  }
  return error_ ? nullptr : &*head_;
}

bool AnswerPlayer::play_read(const Turn& turn) {
  const Record* record = head();
  if (record == nullptr) return wait(error_ ? std::nullopt : std::optional(turn.now));
  arrivals_.look(*record, records_, 0);
  const Instant when = due(arrivals_.first());
  const ByteView rest = record->data.subspan(taken_);
  if (turn.now < when) return wait(when);
  if (turn.out == nullptr) {
    taken_ += rest.size();
    left_ -= std::min<std::uint64_t>(left_, rest.size());
    floor_ = when;
    return true;
  }
  if (turn.blocked) return wait(std::nullopt);
  if (const auto until = pieces_.held_until(turn.now, when)) {
    holds_piece_ = true;
    return wait(until);
  }
  const std::uint64_t offset = record->stream_offset + taken_;
  const ByteView piece = rest.first(pieces_.size(offset, rest.size(), waiting_.front().again));
  const std::size_t room = turn.max_bytes - std::min(turn.max_bytes, turn.out->deliver.size());
  if (room == 0 || (room < piece.size() && !turn.out->deliver.empty())) return wait(turn.now);
  deliver(turn, piece.first(std::min(piece.size(), room)), when);
  return true;
}

void AnswerPlayer::deliver(const Turn& turn, ByteView piece, Instant when) {
  const bool goes_on = arrivals_.continues() && !pieces_.cut();
  if (!delivered_due_) delivered_due_ = pieces_.cut() ? pieces_.free_at(when) : when;
  pieces_.delivered(turn.now);
  if (replies_ == nullptr) {
    append(*turn.out, piece, goes_on);
  } else {
    const std::uint64_t request_end = exchange().writes + index_.request(waiting_.front().exchange).size();
    append(*turn.out, replies_->answer({piece, head_->stream_offset + taken_, request_end}), goes_on);
  }
  taken_ += piece.size();
  left_ -= std::min<std::uint64_t>(left_, piece.size());
  floor_ = when;
  if (taken_ < head_->data.size()) arrivals_.delivered_part();
}

void AnswerPlayer::append(ReplayActions& out, ByteView bytes, bool goes_on) {
  if (bytes.empty()) return;
  out.deliver.insert(out.deliver.end(), bytes.begin(), bytes.end());
  if (std::exchange(delivers_, true) && goes_on) {
    out.block_ends.back() = out.deliver.size();
  } else {
    out.block_ends.push_back(out.deliver.size());
  }
}

bool AnswerPlayer::end_answer(const Turn& turn) {
  if (replies_ != nullptr && replies_->keeps()) {
    if (turn.out != nullptr && turn.blocked) return wait(std::nullopt);
    const Bytes rest = replies_->rest();
    if (turn.out != nullptr) append(*turn.out, rest, true);
  }
  const RequestIndex::End end = exchange().end;
  if (end == RequestIndex::End::hang_up || (end == RequestIndex::End::half_close && half_closes_)) {
    cuts_.reach(exchange().ended);
    const Instant when = due(exchange().ended);
    if (turn.now < when) return wait(when);
    if (turn.out == nullptr || turn.blocked) return wait(std::nullopt);
    floor_ = when;
    if (end == RequestIndex::End::half_close) {
      turn.out->end_sending = true;
      end_sending();
      return wait(std::nullopt);
    }
    turn.out->hang_up = true;
  }
  waiting_.pop_front();
  begun_ = false;
  return true;
}

}  // namespace porttape
