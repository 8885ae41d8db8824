#include "tools/diff_words.hpp"

#include <algorithm>
#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "tools/cat_lines.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

using DiffKind = TapeDifference::Kind;

constexpr std::size_t kBefore = 8;  // bytes shown before the first that differs

std::optional<std::size_t> differ_at(ByteView one, ByteView other) {
  const auto [mine, theirs] = std::mismatch(one.begin(), one.end(), other.begin(), other.end());
  if (mine == one.end() && theirs == other.end()) return std::nullopt;
  return static_cast<std::size_t>(mine - one.begin());
}

std::size_t columns_of_byte(Byte byte) { return to_printable(ByteView(&byte, 1)).size() + 2; }

DifferenceLine bytes_line(bool of_other, char what, ByteView all, std::size_t from, std::size_t columns) {
  DifferenceLine line;
  line.of_other = of_other;
  line.what = what;
  line.offset = std::min(from, all.size());
  const ByteView rest = all.subspan(line.offset);
  std::size_t size = 0;
  for (std::size_t taken = 0; size < rest.size(); ++size) {
    taken += columns_of_byte(rest[size]);
    if (size > 0 && taken > columns) break;
  }
  line.bytes = rest.first(size);
  line.cut = size < rest.size();
  return line;
}

DifferenceLine event_line(bool of_other, const Turn& turn) {
  DifferenceLine line;
  line.of_other = of_other;
  line.what = 'e';
  const std::string details = event_details(turn.event, turn.at, turn.line);
  line.text = printable_line(name_of(turn.event)) + (details.empty() ? "" : "  ") + printable_line(details);
  return line;
}

void mark_differing(DifferenceLine& line, ByteView of_the_other) {
  line.differs.assign(line.bytes.size(), true);
  for (std::size_t i = 0; i < line.bytes.size(); ++i) {
    const std::size_t at = line.offset + i;
    line.differs[i] = at >= of_the_other.size() || of_the_other[at] != line.bytes[i];
  }
}

void add_changed(const Turn& one, const Turn& other, std::size_t columns,
                 std::vector<DifferenceLine>& lines) {
  const auto found = first_difference(one, other);
  if (!found) return;
  const char what = found->written ? 'w' : 'r';
  const Bytes& mine = found->written ? one.writes : one.reads;
  const Bytes& theirs = found->written ? other.writes : other.reads;
  const std::size_t from = found->offset - std::min(found->offset, kBefore);
  lines.push_back(bytes_line(false, what, mine, from, columns));
  mark_differing(lines.back(), theirs);
  lines.push_back(bytes_line(true, what, theirs, from, columns));
  mark_differing(lines.back(), mine);
}

// The first bytes of what was said.
void add_all(const Turn& turn, bool of_other, std::size_t columns, std::vector<DifferenceLine>& lines) {
  if (turn.is_event()) {
    lines.push_back(event_line(of_other, turn));
    return;
  }
  if (!turn.writes.empty()) lines.push_back(bytes_line(of_other, 'w', turn.writes, 0, columns));
  if (!turn.reads.empty() || turn.writes.empty())
    lines.push_back(bytes_line(of_other, 'r', turn.reads, 0, columns));
}

std::string counted_text(std::uint64_t count, std::string_view what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

std::string changed_words(const Turn& one, const Turn& other) {
  const auto found = first_difference(one, other);
  if (!found) return "";
  const std::size_t mine = found->written ? one.writes.size() : one.reads.size();
  const std::size_t theirs = found->written ? other.writes.size() : other.reads.size();
  const bool asked = !one.writes.empty() || !other.writes.empty();
  const std::string_view what = found->written ? "what is asked" : asked ? "the answer" : "what is read";
  if (mine == theirs) return fmt::format("{} from byte {} on", what, found->offset);
  return fmt::format("{} from byte {} on, {} instead of {}", what, found->offset,
                     counted_text(theirs, "byte"), mine);
}

std::string time_words(const ShownDifference& difference) {
  const Turn& one = *difference.one;
  const Turn& other = *difference.other;
  if (difference.what.time == TapeDifference::Time::answer)
    return fmt::format("the answer comes after {}, was {}",
                       span_text(other.answer.value_or(Micros{}).count()),
                       span_text(one.answer.value_or(Micros{}).count()));
  return fmt::format("it comes {} after what is before it, was {}", span_text(other.wait.count()),
                     span_text(one.wait.count()));
}

}  // namespace

std::optional<ByteDifference> first_difference(const Turn& one, const Turn& other) {
  if (const auto at = differ_at(one.writes, other.writes)) return ByteDifference{true, *at};
  if (const auto at = differ_at(one.reads, other.reads)) return ByteDifference{false, *at};
  return std::nullopt;
}

std::vector<DifferenceLine> lines_of(const ShownDifference& difference, std::size_t columns) {
  std::vector<DifferenceLine> lines;
  const bool timing = difference.what.kind == DiffKind::slower || difference.what.kind == DiffKind::faster;
  if (timing) return lines;
  if (difference.what.kind == DiffKind::changed && !difference.one->is_event()) {
    add_changed(*difference.one, *difference.other, columns, lines);
    return lines;
  }
  if (difference.one != nullptr && difference.what.kind != DiffKind::moved)
    add_all(*difference.one, false, columns, lines);
  if (difference.other != nullptr) add_all(*difference.other, true, columns, lines);
  return lines;
}

std::string place_text(const Turn& turn) {
  const std::string at = fmt::format(" at {} s", seconds_number(to_us(turn.at)));
  switch (turn.kind) {
    case Turn::Kind::event:
      return printable_line(name_of(turn.event)) + at;
    case Turn::Kind::unasked:
      return (turn.exchange == 0 ? std::string("unasked data")
                                 : fmt::format("unasked data behind exchange {}", turn.exchange)) +
             at;
    case Turn::Kind::exchange:
    case Turn::Kind::part:
      break;
  }
  const std::string part = turn.part > 0 ? fmt::format(", part {}", turn.part + 1) : "";
  return (turn.exchange == 0 ? "unasked data" : fmt::format("exchange {}", turn.exchange)) + part + at;
}

std::string headline_of(const ShownDifference& difference) {
  if (difference.other == nullptr) return place_text(*difference.one);
  std::string text = place_text(*difference.other);
  if (difference.one != nullptr) {
    const std::string before = place_text(*difference.one);
    const bool moved = difference.what.kind == DiffKind::moved;
    if (before != text || moved) text += ", was " + before;
  }
  if (difference.what.kind == DiffKind::changed && !difference.other->is_event())
    text += ": " + changed_words(*difference.one, *difference.other);
  if (difference.what.kind == DiffKind::slower || difference.what.kind == DiffKind::faster)
    text += ": " + time_words(difference);
  return text;
}

std::string counts_text(const TapeDiff& diff) {
  std::string text;
  for (std::size_t i = 0; i < kTapeDifferenceKinds; ++i) {
    if (diff.counts.at(i) == 0) continue;
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", diff.counts.at(i),
                        to_string(static_cast<DiffKind>(i)));
  }
  return text;
}

std::string agreement_text(const TapeDiff& diff, std::optional<Micros> margin) {
  std::string text = fmt::format(
      "{} of {} exchanges and parts are the same; {}", diff.same, std::max(diff.one.turns, diff.other.turns),
      margin ? "times count from " + span_text(margin->count()) + " on" : "times do not count");
  if (diff.events) return text;
  const bool unknown = !diff.one.has_events || !diff.other.has_events;
  return text +
         (unknown ? "; events are not compared, as not both tapes have some" : "; events are not compared");
}

std::string holdings_text(const ComparedTape& tape) {
  const std::string events = tape.events > 0 ? ", " + counted_text(tape.events, "event") : "";
  return counted_text(tape.exchanges, "exchange") + events;
}

}  // namespace porttape
