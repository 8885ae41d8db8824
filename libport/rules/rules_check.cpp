#include "libport/rules/rules_check.hpp"

#include <algorithm>

#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

using State = FrameCut::State;

// Of an exchange's answer and requests: what is longer is not looked at.
constexpr std::size_t kMostAnswer = std::size_t{1} << 20;
constexpr std::size_t kMostRequests = 4096;

void count(RulesReport::Use& use, const RulesReport::Place& place, ByteView frame, const FrameSpan& span,
           std::uint64_t more = 1) {
  if (use.count == 0) use = {0, place, Bytes(frame.begin(), frame.end()), span};
  use.count += more;
}

}  // namespace

bool RulesReport::any_trouble() const {
  const auto never = [](const Use& use) { return use.count == 0; };
  return !overlaps.empty() || std::any_of(rules.begin(), rules.end(), never) ||
         std::any_of(replies.begin(), replies.end(), never);
}

RulesCheck::RulesCheck(const RuleBook& book) : book_(book) {
  report_.rules.resize(book.set().rules.size());
  report_.replies.resize(book.set().replies.size());
  for (const FrameFormat& format : book.set().frames) report_.formats.push_back({.name = format.name});
}

void RulesCheck::pass(const Record& record) {
  if (record.data.empty()) return;
  if (record.kind == RecordKind::write) pass_write(record);
  if (record.kind == RecordKind::read && answer_.size() < kMostAnswer)
    answer_.insert(answer_.end(), record.data.begin(), record.data.end());
}

void RulesCheck::pass_write(const Record& record) {
  if (!writes_.empty() && record.at - last_ >= book_.idle()) cut_writes(true);
  if (!answer_.empty()) end_answer();
  if (report_.exchanges == 0 || requests_.empty())
    report_.exchanges = std::max<std::uint64_t>(report_.exchanges, 1);
  last_ = record.at;
  pieces_.push_back({{record.at, record.stream_offset, report_.exchanges}, record.data.size()});
  writes_.insert(writes_.end(), record.data.begin(), record.data.end());
  cut_writes(false);
}

void RulesCheck::cut_writes(bool ended) {
  FrameCutter cutter(book_.set().frames);
  std::size_t done = 0;
  while (done < writes_.size()) {
    const FrameCut cut = cutter.cut(writes_, done, ended);
    if (cut.state == State::more) break;
    const ByteView part = ByteView(writes_).subspan(done, cut.size);
    const RulesReport::Place place = pieces_.front().place;
    if (cut.state == State::frame) {
      count_frame(place, part, cut.format);
    } else {
      count(report_.unframed, place, part, {0, part.size()}, part.size());
    }
    pass_pieces(cut.size);
    done += cut.size;
  }
  writes_.erase(writes_.begin(), writes_.begin() + static_cast<std::ptrdiff_t>(done));
}

void RulesCheck::pass_pieces(std::size_t size) {
  while (size > 0) {
    Piece& piece = pieces_.front();
    const std::size_t part = std::min(size, piece.size);
    piece.size -= part;
    piece.place.offset += part;
    size -= part;
    if (piece.size == 0) pieces_.pop_front();
  }
}

void RulesCheck::count_frame(const RulesReport::Place& place, ByteView frame, int format) {
  ++report_.frames;
  RulesReport::Format& of = report_.formats[static_cast<std::size_t>(format)];
  ++of.frames;
  if (const auto holds = book_.checksum_holds(format, frame))
    ++(*holds ? of.checksum_held : of.checksum_wrong);
  const FrameLayout layout = book_.layout(frame, format);
  if (layout.rules.empty()) count(report_.untouched, place, frame, {0, frame.size()});
  for (const int rule : layout.rules) {
    FrameSpan span{0, frame.size()};
    for (const FrameField& field : layout.fields) {
      if (field.of == FrameField::Of::rule && field.rule == rule) span = field.span;
    }
    count(report_.rules[static_cast<std::size_t>(rule)], place, frame, span);
  }
  for (const auto& [one, other] : layout.overlaps) {
    auto found =
        std::find_if(report_.overlaps.begin(), report_.overlaps.end(),
                     [&, a = one, b = other](const auto& each) { return each.one == a && each.other == b; });
    if (found == report_.overlaps.end()) found = report_.overlaps.insert(found, {one, other, {}});
    count(found->use, place, frame, {0, frame.size()});
  }
  if (!report_.replies.empty() && requests_.size() < kMostRequests)
    requests_.push_back({place, format, Bytes(frame.begin(), frame.end())});
}

void RulesCheck::end_answer() {
  cut_writes(true);
  ++report_.exchanges;
  FrameCutter cutter(book_.set().frames);
  for (std::size_t done = 0; !report_.replies.empty() && done < answer_.size();) {
    const FrameCut cut = cutter.cut(answer_, done, true);
    if (cut.state == State::frame) count_answer(ByteView(answer_).subspan(done, cut.size), cut.format);
    done += cut.size;
  }
  answer_.clear();
  requests_.clear();
}

void RulesCheck::count_answer(ByteView frame, int format) {
  for (std::size_t i = 0; i < report_.replies.size(); ++i) {
    const ReplyTemplate& reply = book_.set().replies[i];
    const RuleBook::ReplyPlace places = book_.reply(i);
    if (!book_.fits(frame, format, reply.answer_frame, places.answer)) continue;
    if (!locate(reply.to, places.to, book_.format(format), frame)) continue;
    for (auto request = requests_.rbegin(); request != requests_.rend(); ++request) {
      if (!book_.fits(request->frame, request->format, reply.frame, places.when)) continue;
      const auto from = locate(reply.from, places.from, book_.format(request->format), request->frame);
      if (from) count(report_.replies[i], request->place, request->frame, *from);
      break;
    }
  }
}

RulesReport RulesCheck::finish() {
  cut_writes(true);
  const std::uint64_t exchanges = report_.exchanges;
  if (!answer_.empty()) end_answer();
  report_.exchanges = exchanges;
  return std::move(report_);
}

}  // namespace porttape
