#include "libport/infer/proposal.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <set>
#include <span>

#include "libport/infer/echo.hpp"
#include "libport/infer/frame_expression.hpp"
#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

using What = FoundField::What;

constexpr std::size_t kMostAlone = 32;  // rules for frames of one kind that may be left out

std::string label_of(const FoundSort& sort, const FoundKind& kind) {
  std::string key = sort.sort.text ? to_printable(kind.key) : to_hex(kind.key);
  if (key.empty()) key = sort.sort.format.name.raw();
  return kind.size ? fmt::format("{} of {} bytes", key, *kind.size) : key;
}

std::string times(std::size_t count, std::string_view what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

class Proposer {
 public:
  explicit Proposer(const Findings& findings) : findings_(findings) {}

  Proposal take() {
    for (const FoundSort& sort : findings_.sorts) add_format(sort);
    for (const FoundSort& sort : findings_.sorts)
      for (const FoundField& counter : sort.counters) add_counter(sort, counter);
    for (const FoundKind& kind : findings_.kinds) {
      for (const FoundField& field : kind.fields) add_field(kind, field);
      add_alone(kind);
    }
    return std::move(proposal_);
  }

 private:
  void reason(std::string text) { proposal_.reasons.push_back(std::move(text)); }

  // A protocol's formats come all, as its name in a rules file stands for all.
  void add_format(const FoundSort& sort) {
    const FrameFormat& format = sort.sort.format;
    std::vector<FrameFormat>& frames = proposal_.rules.frames;
    if (format.protocol.empty()) {
      frames.push_back(format);
    } else if (std::ranges::none_of(frames,
                                    [&](const auto& other) { return other.protocol == format.protocol; })) {
      for (FrameFormat& each : protocol_formats(format.protocol)) {
        each.name = format.name;
        frames.push_back(std::move(each));
      }
    }
    if (!format.checksum) return;
    const ChecksumField& sum = *format.checksum;
    reason(fmt::format("frame {}: {} at {}, over the bytes from {} to {}{}: right in all frames of all tapes",
                       format.name.for_line(), sum.kind, sum.at, sum.from, sum.to.value_or(sum.at),
                       sum.hex ? ", as hexadecimal digits" : ""));
  }

  Rule rule_of(const FoundSort& sort, const std::string& label, std::string_view what) {
    Rule rule;
    rule.name = label + " " + std::string(what);
    rule.frame = sort.sort.format.name.raw();
    return rule;
  }

  static void make_counter(Rule& rule, const FoundField& field) {
    rule.kind = Rule::Kind::counter;
    rule.place.at = static_cast<std::int64_t>(field.at);
    rule.place.size = static_cast<std::int64_t>(field.size);
    rule.order = field.little_endian ? ByteOrder::little : ByteOrder::big;
  }

  void add_counter(const FoundSort& sort, const FoundField& field) {
    Rule rule = rule_of(sort, sort.sort.format.name.raw(), fmt::format("counter at {}", field.at));
    make_counter(rule, field);
    if (!sort.sort.format.start.empty()) rule.when = "^" + literal_expression(sort.sort.format.start);
    reason(fmt::format(
        "{}: {} that grows by {} from frame to frame in every tape, and differs between tapes in {}",
        rule.name.for_line(), times(field.size, "byte"), *field.step, times(field.places, "place")));
    std::vector<FrameRun> runs;
    for (const FoundKind& kind : findings_.kinds)
      if (&findings_.sorts[kind.sort] == &sort) runs.insert(runs.end(), kind.runs.begin(), kind.runs.end());
    add_echo(static_cast<std::size_t>(&sort - findings_.sorts.data()), runs, field, rule);
    proposal_.rules.rules.push_back(std::move(rule));
  }

  // Answers that repeat what the request has there have it from the request that came.
  void add_echo(std::size_t sort, std::span<const FrameRun> runs, const FoundField& field, const Rule& rule) {
    if (!is_echoed(findings_, sort, runs, field)) return;
    ReplyTemplate reply;
    reply.name = rule.name.raw() + " echoed";
    reply.frame = reply.answer_frame = rule.frame;
    reply.when = rule.when;
    reply.from = reply.to = rule.place;
    reason(fmt::format("{}: every answer has the same there as its request", reply.name.for_line()));
    proposal_.rules.replies.push_back(std::move(reply));
  }

  void add_field(const FoundKind& kind, const FoundField& field) {
    const FoundSort& sort = findings_.sorts[kind.sort];
    const std::string label = label_of(sort, kind);
    Rule rule;
    switch (field.what) {
      case What::counter: {
        rule = rule_of(sort, label, fmt::format("counter at {}", field.at));
        make_counter(rule, field);
        break;
      }
      case What::bytes: {
        rule = rule_of(sort, label, fmt::format("bytes at {}", field.at));
        rule.place.at = static_cast<std::int64_t>(field.at);
        rule.place.size = static_cast<std::int64_t>(field.size);
        break;
      }
      case What::middle:
        rule = middle_rule(sort, kind, field, label);
        break;
      case What::word:
        rule = word_rule(sort, kind, field, label);
        break;
    }
    rule.when = kind_expression(findings_, kind);
    reason(reason_of(rule, field));
    add_echo(kind.sort, kind.runs, field, rule);
    proposal_.rules.rules.push_back(std::move(rule));
  }

  static std::string reason_of(const Rule& rule, const FoundField& field) {
    const std::string where = times(field.places, "place");
    if (field.step)
      return fmt::format("{}: a number that grows by {} in every tape; differs between tapes in {}",
                         rule.name.for_line(), *field.step, where);
    if (field.what == What::bytes)
      return fmt::format("{}: {}, different between tapes in {}", rule.name.for_line(),
                         times(field.size, "byte"), where);
    return fmt::format("{}: {} to {} bytes, different between tapes in {}", rule.name.for_line(),
                       field.shortest, field.longest, where);
  }

  Rule middle_rule(const FoundSort& sort, const FoundKind& kind, const FoundField& field,
                   const std::string& label) {
    Rule rule = rule_of(sort, label, fmt::format("from {}", field.at));
    const auto run = std::ranges::find_if(kind.runs, [](const FrameRun& each) { return !each.empty(); });
    const std::size_t tail = run->front().size() - sort.body(run->front()).size() + field.tail;
    rule.place.at = static_cast<std::int64_t>(field.at);
    if (tail > 0) rule.place.to = -static_cast<std::int64_t>(tail);
    rule.length = Rule::Length{0, 2 * field.longest + 8};
    if (sort.sort.text) {
      rule.kind = Rule::Kind::regex;
      rule.regex = R"([^\r\n]*)";
    }
    return rule;
  }

  // The number of the column that the word is, if commas cut the frame so that it is one.
  static std::optional<int> column_of(const FoundSort& sort, const FoundKind& kind, const FoundField& field) {
    const std::string& marks = *kind.marks;
    if (!field.pattern.before.empty() || !field.pattern.behind.empty() || field.word == 0)
      return std::nullopt;
    if (marks[field.word - 1] != ',') return std::nullopt;
    const auto& sum = sort.sort.format.checksum;
    const std::size_t skipped = sum && sum->to ? static_cast<std::size_t>(sum->at - *sum->to) : 0;
    const bool last = field.word + skipped == marks.size();
    if (!last && marks[field.word] != ',') return std::nullopt;
    return static_cast<int>(
        std::count(marks.begin(), marks.begin() + static_cast<std::ptrdiff_t>(field.word), ','));
  }

  Rule word_rule(const FoundSort& sort, const FoundKind& kind, const FoundField& field,
                 const std::string& label) {
    Rule rule = rule_of(sort, label, fmt::format("field {}", field.word));
    if (const auto column = column_of(sort, kind, field)) {
      rule.place.by = Place::By::column;
      rule.place.column = *column;
    } else {
      rule.place.by = Place::By::capture;
      rule.place.capture = word_expression(kind, field);
    }
    if (field.step) {
      rule.kind = Rule::Kind::counter;
      rule.type = field.base == 16 ? NumberType::hex : NumberType::decimal;
      if (field.pattern.fixed_size == 0) rule.length = Rule::Length{1, 20};
      return rule;
    }
    rule.kind = Rule::Kind::regex;
    rule.regex = regex_of(field.pattern);
    if (field.pattern.fixed_size == 0)
      rule.length = Rule::Length{field.pattern.may_be_empty ? 0U : 1U,
                                 field.longest + std::max<std::size_t>(8, field.longest)};
    return rule;
  }

  void add_alone(const FoundKind& kind) {
    if (kind.alone.empty()) return;
    const FoundSort& sort = findings_.sorts[kind.sort];
    std::set<std::string> expressions;
    for (const ByteView frame : kind.alone) expressions.insert(frame_expression(sort, kind, frame));
    if (expressions.size() > kMostAlone) expressions = {kind_expression(findings_, kind)};
    const std::string label = label_of(sort, kind);
    for (const std::string& expression : expressions) {
      Rule rule = rule_of(sort, label, "any number of times");
      if (expressions.size() > 1)
        rule.name = fmt::format("{} ({})", rule.name.raw(), proposal_.rules.rules.size());
      rule.kind = Rule::Kind::frame;
      rule.when = expression;
      rule.optional = rule.repeated = true;
      proposal_.rules.rules.push_back(std::move(rule));
    }
    reason(fmt::format("{}: {} of {} {} in one tape and not at that place in another", label,
                       kind.alone.size(), times(kind.frames(), "frame"),
                       kind.alone.size() == 1 ? "is" : "are"));
  }

  const Findings& findings_;
  Proposal proposal_;
};

}  // namespace

Proposal propose(const Findings& findings) { return Proposer(findings).take(); }

}  // namespace porttape
