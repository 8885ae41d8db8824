#include "libport/rules/rule_expectation.hpp"

#include <algorithm>

#include "libport/rules/rule_replies.hpp"

namespace porttape {
namespace {

using Held = Expectation::Held;
using Memory = Expectation::Memory;
using Stretch = Expectation::Stretch;
using State = FrameCut::State;

std::size_t same_bytes(ByteView one, ByteView other) { return Expectation::exactly(one, other).recorded; }

void end_frame(Memory& memory) {
  memory.frame.clear();
  memory.recorded.clear();
  memory.settled = false;
  memory.left_out = Expectation::LeftOut::no;
  memory.format = -1;
}

// What came for the frame is as it may be; what is in `came` still is for the next one.
Held use_rest(const Stretch& recorded, Memory& memory, std::size_t came) {
  const std::size_t left = memory.frame.size() - memory.recorded.size();
  const std::size_t now = std::min(left, recorded.bytes.size());
  const Expectation::LeftOut left_out = memory.left_out;
  append(memory.recorded, recorded.bytes.first(now));
  if (now == left) end_frame(memory);
  return {.recorded = now, .came = came, .goes_on = now < left || !memory.came.empty(), .left_out = left_out};
}

Held settle(const Stretch& recorded, Memory& memory, std::size_t came) {
  memory.settled = true;
  return use_rest(recorded, memory, came);
}

// A frame of which nothing was used: it differs from its byte `recorded_at` on, what came from `came_at` on.
Held differs(const Stretch& recorded, Memory& memory, std::size_t used, std::size_t recorded_at,
             std::size_t came_at, std::string why) {
  memory.blame = {0, memory.came.size() - came_at, std::move(why)};
  return {std::min(recorded_at, recorded.bytes.size()), used, true};
}

Held leave_out(const Stretch& recorded, const FrameLayout& layout, Memory& memory, std::size_t came) {
  using LeftOut = Expectation::LeftOut;
  memory.left_out = LeftOut::not_known;
  if (layout.with_answer) memory.left_out = *layout.with_answer ? LeftOut::with_answer : LeftOut::alone;
  return settle(recorded, memory, came);
}

bool is_begun(const Memory& memory) { return memory.came.size() > memory.recorded.size(); }

}  // namespace

Expectation::Reach RuleExpectation::reach() const { return {book_->longest(), book_->idle()}; }

std::unique_ptr<Replies> RuleExpectation::replies() const {
  if (book_->set().replies.empty()) return nullptr;
  return std::make_unique<RuleReplies>(book_);
}

bool RuleExpectation::leaves_out() const {
  return std::ranges::any_of(book_->set().rules, [](const Rule& rule) { return rule.optional; });
}

Held RuleExpectation::hold(const Stretch& recorded, ByteView came, Memory& memory) const {
  if (memory.settled) return use_rest(recorded, memory, 0);
  if (memory.frame.empty()) begin_frame(recorded, memory);
  const FrameLayout layout = book_->layout(memory.frame, memory.format);
  if (came.empty()) return without_bytes(recorded, layout, memory);
  if (layout.varies || layout.optional || book_->any_repeated() || is_begun(memory))
    return hold_whole(recorded, came, layout, memory);
  return hold_in_place(recorded, came, layout, memory);
}

// Only frames that may be repeated.
Held RuleExpectation::hold_beyond(ByteView came, Memory& memory) const {
  const std::size_t before = memory.came.size();
  append(memory.came, came.first(std::min(came.size(), book_->longest() + 1)));
  const bool any = book_->any_repeated() && !memory.came.empty();
  const FrameCut cut = any ? cut_frame(book_->set().frames, memory.came, memory.ended) : FrameCut{};
  if (cut.state == State::more) return {.came = memory.came.size() - before};
  if (cut.state == State::frame && cut.size >= before) {
    memory.came.resize(cut.size);
    if (repeats(cut.format, memory)) {
      book_->repeat(cut.format, memory.came, memory.counted);
      memory.came.clear();
      return {.came = cut.size - before};
    }
  }
  memory.came.resize(before);
  memory.blame = {0, before, {}};
  return {.differs = true};
}

// What is no frame on the tape is taken as one of no format.
void RuleExpectation::begin_frame(const Stretch& recorded, Memory& memory) const {
  const auto& formats = book_->set().frames;
  Bytes all;
  ByteView front = recorded.bytes;
  FrameCut cut = cut_frame(formats, front, recorded.ahead.empty() && recorded.ahead_ends);
  if (cut.state == State::more) {
    append(all, recorded.bytes);
    append(all, recorded.ahead);
    front = all;
    cut = cut_frame(formats, front, recorded.ahead_ends);
  }
  const bool is_frame = cut.state == State::frame;
  const ByteView frame = front.first(cut.state == State::more ? 1 : cut.size);
  memory.frame.assign(frame.begin(), frame.end());
  memory.format = is_frame ? cut.format : -1;
  memory.sums_right = book_->checksum_holds(memory.format, memory.frame).value_or(memory.sums_right);
}

// If the tape's checksums are right, a frame with a wrong checksum repeats none of them.
bool RuleExpectation::repeats(int format, const Memory& memory) const {
  if (memory.sums_right && !book_->checksum_holds(format, memory.came).value_or(true)) return false;
  return book_->repeats(memory.came, format).has_value();
}

Held RuleExpectation::hold_in_place(const Stretch& recorded, ByteView came, const FrameLayout& layout,
                                    Memory& memory) const {
  const std::size_t begin = memory.recorded.size();
  const std::size_t end = begin + std::min({memory.frame.size() - begin, recorded.bytes.size(), came.size()});
  std::size_t at = begin;
  for (auto field = layout.fields.begin(); at < end;) {
    while (field != layout.fields.end() && field->span.end <= at) ++field;
    const bool any = field != layout.fields.end();
    const std::size_t exact_end = any ? std::max(at, std::min(end, field->span.begin)) : end;
    at += same_bytes(recorded.bytes.subspan(at - begin, exact_end - at),
                     came.subspan(at - begin, exact_end - at));
    if (at < exact_end) break;
    if (any) at = std::max(at, std::min(end, field->span.end));
  }
  const std::size_t used = at - begin;
  append(memory.recorded, recorded.bytes.first(used));
  append(memory.came, came.first(used));
  if (at < end) {
    memory.blame = {};
    return {used, used, true};
  }
  if (at < memory.frame.size()) return {used, used, false};
  if (!layout.fields.empty()) {
    auto judgement = book_->judge(memory.format, memory.frame, memory.came, memory.counted);
    if (!judgement.right) {
      memory.blame = {at - judgement.recorded, at - judgement.came, std::move(judgement.why)};
      return {used, used, true};
    }
  }
  end_frame(memory);
  memory.came.clear();
  return {used, used, false};
}

// What came is cut by the formats as the tape is, whatever the recorded frame's is.
FrameCut RuleExpectation::cut_of(ByteView came, const Memory& memory, bool ended) const {
  const std::size_t same = same_bytes(memory.frame, came);
  if (memory.format < 0 && same == std::min(came.size(), memory.frame.size()))
    return {same == memory.frame.size() ? State::frame : State::more, same, -1};
  return cut_frame(book_->set().frames, came, ended);
}

Held RuleExpectation::hold_whole(const Stretch& recorded, ByteView came, const FrameLayout& layout,
                                 Memory& memory) const {
  const std::size_t before = memory.came.size();
  // No more than decides: what is longer is no frame.
  append(memory.came, came.first(std::min(came.size(), book_->longest() + 1)));
  const FrameCut cut = cut_of(memory.came, memory, false);
  if (cut.state == State::frame && cut.size >= before) {
    memory.came.resize(cut.size);
    return judge_whole(recorded, layout, cut.size - before, cut.format, memory);
  }
  const std::size_t fixed = layout.fields.empty() ? memory.frame.size() : layout.fields.front().span.begin;
  const std::size_t same = same_bytes(ByteView(memory.frame).first(fixed), memory.came);
  const bool another_may = book_->any_repeated() || layout.optional;
  const bool wrong = same < std::min(fixed, memory.came.size()) && !another_may;
  if (cut.state != State::more || wrong) {
    const std::size_t kept = std::max(same, before);
    memory.came.resize(kept);
    return differs(recorded, memory, kept - before, same, same, {});
  }
  return {.recorded = 0, .came = memory.came.size() - before};
}

Held RuleExpectation::judge_whole(const Stretch& recorded, const FrameLayout& layout, std::size_t used,
                                  int format, Memory& memory) const {
  RuleBook::Judgement judgement;
  if (format == memory.format) {
    judgement = book_->judge(format, memory.frame, memory.came, memory.counted);
  } else {
    judgement.recorded = judgement.came = same_bytes(memory.frame, memory.came);
  }
  if (judgement.right) {
    memory.came.clear();
    return settle(recorded, memory, used);
  }
  if (repeats(format, memory)) {
    book_->repeat(format, memory.came, memory.counted);
    memory.came.clear();
    return {.recorded = 0, .came = used, .goes_on = used == 0};
  }
  if (layout.optional) {
    // Should nothing follow on the tape, all that came is too much.
    memory.blame = {0, memory.came.size(), {}};
    book_->skip(memory.format, memory.frame, memory.counted);
    return leave_out(recorded, layout, memory, used);
  }
  return differs(recorded, memory, used, judgement.recorded, judgement.came, std::move(judgement.why));
}

// A pause, the end, or what came is to be held against the next frame of the tape.
Held RuleExpectation::without_bytes(const Stretch& recorded, const FrameLayout& layout,
                                    Memory& memory) const {
  if (memory.came.empty() && memory.ended && layout.optional) {
    book_->skip(memory.format, memory.frame, memory.counted);
    return leave_out(recorded, layout, memory, 0);
  }
  if (!is_begun(memory)) return {};
  const FrameFormat* format = book_->format(memory.format);
  const bool idle = format != nullptr && format->kind == FrameFormat::Kind::idle;
  const FrameCut cut = cut_of(memory.came, memory, memory.ended || idle);
  if (cut.state == State::frame && cut.size == memory.came.size()) {
    // A pause may also be one within a frame.
    auto counted = memory.counted;
    const bool may_go_on = idle && !memory.ended && memory.came.size() < memory.frame.size();
    if (may_go_on && !book_->judge(memory.format, memory.frame, memory.came, counted).right) return {};
    return judge_whole(recorded, layout, 0, cut.format, memory);
  }
  if (!memory.ended) return {};
  const std::size_t same = same_bytes(memory.frame, memory.came);
  if (same == memory.came.size()) return {};
  return differs(recorded, memory, 0, same, same, {});
}

}  // namespace porttape
