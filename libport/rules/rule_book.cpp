#include "libport/rules/rule_book.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>

#include "libport/base/printable.hpp"
#include "libport/rules/checksum.hpp"
#include "libport/rules/frame_number.hpp"

namespace porttape {
namespace {

std::unique_ptr<re2::RE2> compiled(const std::string& text, std::size_t count) {
  if (text.empty()) return nullptr;
  auto expression = std::make_unique<re2::RE2>(text, rule_expression_options(count));
  return expression->ok() ? std::move(expression) : nullptr;
}

std::optional<FrameChecksum> checksum_in(const FrameFormat* format) {
  if (format == nullptr || !format->checksum) return std::nullopt;
  const ChecksumKind* kind = find_checksum(format->checksum->kind);
  if (kind == nullptr) return std::nullopt;
  return FrameChecksum(*format->checksum, *kind);
}

FrameSpan span_of_length(const FrameFormat& format) {
  const auto at = static_cast<std::size_t>(format.length.at);
  return {at, at + static_cast<std::size_t>(format.length.size)};
}

bool overlap(const FrameSpan& one, const FrameSpan& other) {
  return one.begin < other.end && other.begin < one.end;
}

// The first place where they differ; their common size where they do not.
std::size_t difference(ByteView one, ByteView other) { return Expectation::exactly(one, other).recorded; }

constexpr std::size_t kShown = 24;

}  // namespace

std::string name_of(const RuleSet& set, const Rule& rule) {
  std::string name = "rule " + rule.name.in_quotes();
  if (rule.line.number > 0) name += fmt::format(" ({}:{})", printable_line(set.file), rule.line.number);
  return name;
}

RuleBook::RuleBook(RuleSet set) : set_(std::move(set)) {
  const std::size_t count = 3 * set_.rules.size() + 4 * set_.replies.size();
  for (const Rule& rule : set_.rules) {
    rules_.push_back(
        {compiled(rule.when, count), compiled(rule.place.capture, count), compiled(rule.regex, count)});
    any_repeated_ = any_repeated_ || rule.repeated;
  }
  for (const ReplyTemplate& reply : set_.replies) {
    replies_.push_back({compiled(reply.when, count), compiled(reply.from.capture, count),
                        compiled(reply.answer, count), compiled(reply.to.capture, count)});
  }
}

std::size_t RuleBook::longest() const {
  std::size_t longest = 1;
  for (const FrameFormat& format : set_.frames) longest = std::max(longest, format.longest);
  return longest;
}

Micros RuleBook::idle() const {
  Micros idle = Micros::max();
  for (const FrameFormat& format : set_.frames) {
    if (format.kind == FrameFormat::Kind::idle) idle = std::min(idle, format.idle);
  }
  return idle;
}

RuleBook::ReplyPlace RuleBook::reply(std::size_t number) const {
  const CompiledReply& reply = replies_[number];
  return {reply.when.get(), reply.from.get(), reply.answer.get(), reply.to.get()};
}

bool RuleBook::fits(ByteView frame, int number, const std::string& name, const re2::RE2* when) const {
  if (number < 0 || (!name.empty() && format(number)->name != name)) return false;
  const re2::StringPiece text = as_piece(frame);
  return when == nullptr || when->Match(text, 0, text.size(), re2::RE2::UNANCHORED, nullptr, 0);
}

FrameLayout RuleBook::layout(ByteView frame, int number) const {
  FrameLayout layout;
  for (std::size_t i = 0; i < rules_.size(); ++i) {
    const Rule& rule = set_.rules[i];
    if (!fits(frame, number, rule.frame, rules_[i].when.get())) continue;
    const int own = static_cast<int>(i);
    if (rule.kind == Rule::Kind::frame) {
      layout.rules.push_back(own);
      if (rule.optional && !layout.optional) layout.with_answer = rule.with_answer;
      layout.optional = layout.optional || rule.optional;
      continue;
    }
    const auto span = locate(rule.place, rules_[i].place.get(), format(number), frame);
    if (!span) continue;
    layout.rules.push_back(own);
    const auto taken = std::find_if(layout.fields.begin(), layout.fields.end(),
                                    [&](const FrameField& field) { return overlap(field.span, *span); });
    if (taken != layout.fields.end()) {
      layout.overlaps.emplace_back(taken->rule, own);
      continue;
    }
    layout.fields.push_back({FrameField::Of::rule, own, *span});
    layout.varies = layout.varies || rule.length.has_value();
  }
  if (!layout.fields.empty()) add_derived(frame, number, layout);
  std::sort(layout.fields.begin(), layout.fields.end(), [](const FrameField& one, const FrameField& other) {
    return one.span.begin != other.span.begin ? one.span.begin < other.span.begin
                                              : one.span.end < other.span.end;
  });
  return layout;
}

// What follows from the bytes that vary: the checksum, if it holds, and the length.
void RuleBook::add_derived(ByteView frame, int number, FrameLayout& layout) const {
  const auto add = [&](FrameField::Of of, const FrameSpan& span) {
    const bool taken = std::any_of(layout.fields.begin(), layout.fields.end(),
                                   [&](const FrameField& field) { return overlap(field.span, span); });
    if (!taken && span.end <= frame.size()) layout.fields.push_back({of, -1, span});
  };
  const FrameFormat* own = format(number);
  if (const auto checksum = checksum_in(own); checksum && checksum->holds(frame)) {
    const auto place = checksum->place(frame);
    add(FrameField::Of::checksum, {place->begin, place->end});
  }
  if (layout.varies && own->kind == FrameFormat::Kind::length)
    add(FrameField::Of::length, span_of_length(*own));
}

std::optional<int> RuleBook::repeats(ByteView came, int number) const {
  for (std::size_t i = 0; i < rules_.size(); ++i) {
    const Rule& rule = set_.rules[i];
    if (rule.repeated && fits(came, number, rule.frame, rules_[i].when.get())) return static_cast<int>(i);
  }
  return std::nullopt;
}

std::optional<FrameSpan> RuleBook::span_of(const FrameField& field, int number, ByteView frame) const {
  if (field.of == FrameField::Of::rule) {
    const auto rule = static_cast<std::size_t>(field.rule);
    return locate(set_.rules[rule].place, rules_[rule].place.get(), format(number), frame);
  }
  if (field.of == FrameField::Of::length) {
    const FrameSpan span = span_of_length(*format(number));
    return span.end <= frame.size() ? std::optional(span) : std::nullopt;
  }
  const auto place = checksum_in(format(number))->place(frame);
  if (!place) return std::nullopt;
  return FrameSpan{place->begin, place->end};
}

RuleBook::Judgement RuleBook::judge(int number, ByteView recorded, ByteView came, Counted& counted) const {
  const FrameLayout layout = this->layout(recorded, number);
  Counted next = counted;
  std::size_t recorded_at = 0;
  std::size_t came_at = 0;
  for (const FrameField& field : layout.fields) {
    const auto there = span_of(field, number, came);
    const bool found = there && there->begin >= came_at && there->end <= came.size();
    const ByteView before = recorded.subspan(recorded_at, field.span.begin - recorded_at);
    const ByteView before_came =
        came.subspan(came_at, found ? there->begin - came_at : came.size() - came_at);
    const std::size_t same = difference(before, before_came);
    if (!found || same < before.size() || same < before_came.size())
      return {false, recorded_at + same, came_at + same, {}};
    std::string why = wrong_with(field, number, field.span.of(recorded), there->of(came), came, next);
    if (!why.empty()) return {false, field.span.begin, there->begin, std::move(why)};
    recorded_at = field.span.end;
    came_at = there->end;
  }
  const std::size_t same = difference(recorded.subspan(recorded_at), came.subspan(came_at));
  if (recorded_at + same < recorded.size() || came_at + same < came.size())
    return {false, recorded_at + same, came_at + same, {}};
  counted = std::move(next);
  return {.right = true};
}

std::string RuleBook::wrong_with(const FrameField& field, int number, ByteView recorded, ByteView came,
                                 ByteView whole, Counted& counted) const {
  if (field.of == FrameField::Of::length) return {};
  if (field.of == FrameField::Of::checksum) {
    const auto checksum = checksum_in(format(number));
    const auto right = checksum->expected(whole, recorded);
    if (right && std::equal(right->begin(), right->end(), came.begin(), came.end())) return {};
    if (!right) return fmt::format("the checksum {} of these bytes cannot be told", checksum->name());
    const bool text = format(number)->checksum->hex;
    const std::string is = text ? to_printable(came) : to_hex(came);
    return fmt::format("the checksum {} is {} and should be {}", checksum->name(), is,
                       text ? to_printable(*right) : to_hex(*right));
  }
  const Rule& rule = set_.rules[static_cast<std::size_t>(field.rule)];
  const bool same = std::equal(came.begin(), came.end(), recorded.begin(), recorded.end());
  if (same && rule.kind != Rule::Kind::counter) return {};  // whatever it is
  std::string why;
  if (rule.length && (came.size() < rule.length->least || came.size() > rule.length->most)) {
    why = fmt::format("has {} bytes; accepted: {} to {}", came.size(), rule.length->least, rule.length->most);
  } else if (!rule.length && came.size() != recorded.size()) {
    why = fmt::format("has {} bytes; accepted: {}, as recorded", came.size(), recorded.size());
  } else {
    why = wrong_value(field.rule, recorded, came, counted);
  }
  if (why.empty()) return {};
  return fmt::format("{}: {} {}", name_of(set_, rule), text_and_hex(came, kShown), why);
}

std::string RuleBook::wrong_value(int number, ByteView recorded, ByteView came, Counted& counted) const {
  using Kind = Rule::Kind;
  const Rule& rule = set_.rules[static_cast<std::size_t>(number)];
  switch (rule.kind) {
    case Kind::mask: {
      // As many bytes came as are recorded, because a mask has no `length`.
      const bool fits_mask = rule.mask.size() == came.size();
      for (std::size_t i = 0; i < came.size(); ++i) {
        const Byte bits = fits_mask ? rule.mask[i] : Byte{0xff};
        if (((came[i] ^ recorded[i]) & bits) != 0)
          return fmt::format("differs from {} in bits of the mask", to_hex(recorded));
      }
      return {};
    }
    case Kind::regex: {
      const re2::RE2* expression = rules_[static_cast<std::size_t>(number)].regex.get();
      const bool right = expression != nullptr && re2::RE2::FullMatch(as_piece(came), *expression);
      return right ? "" : fmt::format("does not match {}", printable_line(rule.regex));
    }
    case Kind::range: {
      const auto value = real_number(rule, came);
      if (value && *value >= rule.least && *value <= rule.most) return {};
      return value ? fmt::format("is {}; accepted: {} to {}", *value, rule.least, rule.most) : "is no number";
    }
    case Kind::counter:
      return wrong_count(number, recorded, came, counted);
    case Kind::ignore:
    case Kind::frame:
      break;
  }
  return {};
}

std::string RuleBook::wrong_count(int number, ByteView recorded, ByteView came, Counted& counted) const {
  const Rule& rule = set_.rules[static_cast<std::size_t>(number)];
  const auto value = whole_number_in(rule, came);
  const auto on_tape = whole_number_in(rule, recorded);
  const bool same = std::equal(came.begin(), came.end(), recorded.begin(), recorded.end());
  if (!value) return same ? "" : "is no number";
  if (!on_tape) return "stands for what is no number on the tape";
  counted.resize(rules_.size());
  auto& last = counted[static_cast<std::size_t>(number)];
  const auto before = std::exchange(last, {true, *value, *on_tape});
  if (!before.any) return {};
  const std::uint64_t due = counted_on(rule, came.size(), before.came, *on_tape - before.recorded);
  return *value == due ? "" : fmt::format("is {} after {}; due: {}", *value, before.came, due);
}

void RuleBook::skip(int number, ByteView recorded, Counted& counted) const {
  for (const FrameField& field : layout(recorded, number).fields) {
    if (field.of != FrameField::Of::rule) continue;
    const auto rule = static_cast<std::size_t>(field.rule);
    if (set_.rules[rule].kind != Rule::Kind::counter || rule >= counted.size()) continue;
    const auto value = whole_number_in(set_.rules[rule], field.span.of(recorded));
    if (value) counted[rule].recorded = *value;
  }
}

void RuleBook::repeat(int number, ByteView came, Counted& counted) const {
  for (const FrameField& field : layout(came, number).fields) {
    if (field.of != FrameField::Of::rule) continue;
    const auto rule = static_cast<std::size_t>(field.rule);
    if (set_.rules[rule].kind != Rule::Kind::counter || rule >= counted.size()) continue;
    const auto value = whole_number_in(set_.rules[rule], field.span.of(came));
    if (value) counted[rule].came = *value;
  }
}

std::optional<bool> RuleBook::checksum_holds(int number, ByteView frame) const {
  const auto checksum = checksum_in(format(number));
  if (!checksum) return std::nullopt;
  return checksum->holds(frame);
}

void RuleBook::mend(int number, ByteView before, Bytes& frame) const {
  const FrameFormat* own = format(number);
  if (own == nullptr) return;
  if (own->kind == FrameFormat::Kind::length && before.size() != frame.size()) {
    const LengthField& length = own->length;
    auto value = static_cast<std::uint64_t>(static_cast<std::int64_t>(frame.size()) - length.adds);
    for (std::int64_t i = 0; i < length.size; ++i) {
      const std::int64_t at = length.at + (length.order == ByteOrder::little ? i : length.size - 1 - i);
      frame.at(static_cast<std::size_t>(at)) = static_cast<Byte>(value);
      value >>= 8;
    }
  }
  const auto checksum = checksum_in(own);
  if (!checksum || !checksum->holds(before)) return;
  const auto place = checksum->place(frame);
  const auto right = checksum->expected(frame);
  if (place && right)
    std::copy(right->begin(), right->end(), frame.begin() + static_cast<std::ptrdiff_t>(place->begin));
}

}  // namespace porttape
