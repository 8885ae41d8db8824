#include "libport/rules/rule_replies.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

using State = FrameCut::State;

constexpr std::size_t kMostPairBytes = std::size_t{256} * 1024;

void drop(Bytes& bytes, std::size_t count) {
  bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(std::min(count, bytes.size())));
}
Bytes front(const Bytes& bytes, std::size_t count) {
  return Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count));
}

}  // namespace

RuleReplies::RuleReplies(std::shared_ptr<const RuleBook> book) : book_(std::move(book)) {}

void RuleReplies::begin() {
  begin_ = request_begin_ = request_end_ = 0;
  recorded_.clear();
  came_.clear();
  pairs_.clear();
  pair_bytes_ = 0;
  kept_.clear();
}

void RuleReplies::asked(const Asked& asked) {
  if (asked.offset != begin_ + recorded_.size()) {
    recorded_.clear();
    came_.clear();
    begin_ = asked.offset;
  }
  append(recorded_, asked.recorded);
  append(came_, asked.came);
  pair_up(false);
}

void RuleReplies::pair_up(bool ended) {
  while (!recorded_.empty() && pair_next(ended)) {
  }
  // Without an end in sight it is no frame of ours.
  const std::size_t most = book_->longest() * 2;
  if (recorded_.size() <= most && came_.size() <= most) return;
  begin_ += recorded_.size();
  recorded_.clear();
  came_.clear();
}

// Takes a frame, or what is none, off the fronts. False: more has to come.
bool RuleReplies::pair_next(bool ended) {
  const FrameCut cut = cut_frame(book_->set().frames, recorded_, ended);
  if (cut.state == State::more) return false;
  const ByteView recorded = ByteView(recorded_).first(cut.size);
  std::size_t came = cut.size;
  if (cut.state == State::frame) {
    const FrameCut cut_came =
        came_.empty() ? FrameCut{State::more} : cut_frame(book_->set().frames, came_, ended);
    if (cut_came.state == State::more && !ended) return false;
    came = cut_came.state == State::frame ? cut_came.size : 0;
    RuleBook::Counted any;
    const bool right = came > 0 && cut_came.format == cut.format &&
                       book_->judge(cut.format, recorded, ByteView(came_).first(came), any).right;
    if (right) add({begin_ + cut.size, cut.format, front(recorded_, cut.size), front(came_, came)});
    if (came > 0 && !right && book_->repeats(ByteView(came_).first(came), cut_came.format)) {
      drop(came_, came);
      return true;
    }
    if (!right) came = 0;  // the recorded one was left out
  } else if (came_.size() < came && !ended) {
    return false;
  }
  drop(recorded_, cut.size);
  drop(came_, came);
  begin_ += cut.size;
  return true;
}

void RuleReplies::add(Pair pair) {
  pair_bytes_ += pair.recorded.size() + pair.came.size();
  pairs_.push_back(std::move(pair));
  while (pair_bytes_ > kMostPairBytes) {
    pair_bytes_ -= pairs_.front().recorded.size() + pairs_.front().came.size();
    pairs_.pop_front();
  }
}

// The latest frame of the request that the template is about; null: none is.
const RuleReplies::Pair* RuleReplies::request_of(std::size_t number) const {
  const ReplyTemplate& reply = book_->set().replies[number];
  for (auto pair = pairs_.rbegin(); pair != pairs_.rend(); ++pair) {
    const bool asked = pair->end > request_begin_ && pair->end <= request_end_;
    if (asked && book_->fits(pair->recorded, pair->format, reply.frame, book_->reply(number).when))
      return &*pair;
  }
  return nullptr;
}

bool RuleReplies::any_request() const {
  std::size_t number = 0;
  return std::ranges::any_of(book_->set().replies,
                             [&](const ReplyTemplate&) { return request_of(number++) != nullptr; });
}

Bytes RuleReplies::answer(const Read& read) {
  Bytes out;
  if (read.writes != request_end_) {
    out = rest();
    request_begin_ = request_end_ < read.writes ? request_end_ : 0;
    request_end_ = read.writes;
    pair_up(true);
  }
  if (kept_.empty() && !any_request()) {
    append(out, read.bytes);
    return out;
  }
  append(kept_, read.bytes);
  take_frames(false, out);
  return out;
}

Bytes RuleReplies::rest() {
  Bytes out;
  take_frames(true, out);
  append(out, kept_);
  kept_.clear();
  return out;
}

void RuleReplies::take_frames(bool ended, Bytes& out) {
  FrameCutter cutter(book_->set().frames);
  std::size_t done = 0;
  while (done < kept_.size()) {
    const FrameCut cut = cutter.cut(kept_, done, ended);
    if (cut.state == State::more) break;
    const ByteView part = ByteView(kept_).subspan(done, cut.size);
    if (cut.state == State::frame) {
      append(out, rewritten(part, cut.format));
    } else {
      append(out, part);
    }
    done += cut.size;
  }
  drop(kept_, done);
}

Bytes RuleReplies::rewritten(ByteView frame, int format) const {
  Bytes out(frame.begin(), frame.end());
  bool any = false;
  for (std::size_t i = 0; i < book_->set().replies.size(); ++i) {
    const ReplyTemplate& reply = book_->set().replies[i];
    const RuleBook::ReplyPlace places = book_->reply(i);
    const Pair* request = request_of(i);
    if (request == nullptr || !book_->fits(frame, format, reply.answer_frame, places.answer)) continue;
    const auto from = locate(reply.from, places.from, book_->format(request->format), request->came);
    const auto to = locate(reply.to, places.to, book_->format(format), out);
    if (!from || !to) continue;
    const ByteView value = from->of(request->came);
    const auto begin = out.erase(out.begin() + static_cast<std::ptrdiff_t>(to->begin),
                                 out.begin() + static_cast<std::ptrdiff_t>(to->end));
    out.insert(begin, value.begin(), value.end());
    any = true;
  }
  if (any) book_->mend(format, frame, out);
  return out;
}

}  // namespace porttape
