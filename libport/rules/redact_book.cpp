#include "libport/rules/redact_book.hpp"

#include <array>
#include <string>
#include <utility>

namespace porttape {
namespace {

std::unique_ptr<re2::RE2> redact_expression(const std::string& text, std::size_t count) {
  if (text.empty()) return nullptr;
  return std::make_unique<re2::RE2>(re2::StringPiece(text.data(), text.size()),
                                    rule_expression_options(count));
}

RuleSet frames_alone(const RuleSet& set) {
  RuleSet frames;
  frames.file = set.file;
  frames.frames = set.frames;
  return frames;
}

}  // namespace

RedactBook::RedactBook(const RuleSet& set, const Filler::Key& key)
    : rules_(set.redactions), frames_(frames_alone(set)), filler_(key, set.frames) {
  const std::size_t count = 2 * rules_.size();
  for (const RedactRule& rule : rules_) {
    std::string place = rule.kind == RedactRule::Kind::pattern ? rule.pattern : rule.place.capture;
    if (rule.kind == RedactRule::Kind::text) place = re2::RE2::QuoteMeta(as_piece(rule.text));
    compiled_.push_back({redact_expression(rule.when, count), redact_expression(place, count)});
  }
}

std::optional<FrameSpan> RedactBook::secret_in(std::size_t rule, int format, ByteView frame) const {
  const RedactRule& asked = rules_[rule];
  if (!frames_.fits(frame, format, asked.frame, compiled_[rule].when.get())) return std::nullopt;
  return locate(asked.place, compiled_[rule].place.get(), frames_.format(format), frame);
}

std::optional<RedactBook::Match> RedactBook::find(std::size_t rule, ByteView bytes, std::size_t begin,
                                                  std::size_t end, bool only_at_begin) const {
  const re2::RE2& expression = *compiled_[rule].place;
  const int groups = expression.NumberOfCapturingGroups() > 0 ? 2 : 1;
  std::array<re2::StringPiece, 2> found;
  const re2::StringPiece text = as_piece(bytes);
  const auto anchor = only_at_begin ? re2::RE2::ANCHOR_START : re2::RE2::UNANCHORED;
  if (!expression.Match(text, begin, end, anchor, found.data(), groups)) return std::nullopt;
  const auto span_of = [&](const re2::StringPiece& piece) {
    const auto from = static_cast<std::size_t>(piece.data() - text.data());
    return FrameSpan{from, from + piece.size()};
  };
  const FrameSpan whole = span_of(found[0]);
  const bool has_group = groups == 2 && found[1].data() != nullptr;
  return Match{whole.begin, whole.end, has_group ? span_of(found[1]) : whole};
}

std::size_t RedactBook::longest(std::size_t rule) const {
  return rules_[rule].kind == RedactRule::Kind::text ? rules_[rule].text.size() + 1
                                                     : rules_[rule].longest + 1;
}

}  // namespace porttape
