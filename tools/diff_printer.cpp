#include "tools/diff_printer.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ostream.h>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "tools/output.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

using DiffKind = TapeDifference::Kind;

constexpr std::size_t kBytesShown = 24;  // of a turn in JSON

Color diff_color(DiffKind kind) {
  switch (kind) {
    case DiffKind::added:
      return Color::good;
    case DiffKind::missing:
      return Color::bad;
    default:
      return Color::doubtful;
  }
}

std::string hex_around(const Bytes& bytes, std::size_t from) {
  const std::size_t begin = std::min(from, bytes.size());
  return to_hex(ByteView(bytes).subspan(begin, std::min(kBytesShown, bytes.size() - begin)));
}

void add_turn(JsonObject& json, std::string_view key, const Turn* turn) {
  if (turn == nullptr) {
    json.add_raw(key, "null");
    return;
  }
  JsonObject each;
  each.add("t_us", to_us(turn->at));
  if (turn->is_event()) {
    each.add_raw("event", json_for_terminal(turn->line));
  } else {
    each.add("until_us", to_us(turn->until))
        .add("exchange", turn->exchange)
        .add("part", turn->part)
        .add_raw("unasked", turn->kind == Turn::Kind::unasked ? "true" : "false")
        .add("write_bytes", turn->writes.size())
        .add("read_bytes", turn->reads.size())
        .add("wait_us", turn->wait.count())
        .add_or_null("answer_us", turn->answer ? std::optional(turn->answer->count()) : std::nullopt)
        .add("write_hex", hex_around(turn->writes, 0))
        .add("read_hex", hex_around(turn->reads, 0));
  }
  json.add(key, each);
}

JsonObject compared_json(const std::string& name, const ComparedTape& tape) {
  return JsonObject()
      .add("tape", name)
      .add("exchanges", tape.exchanges)
      .add("turns", tape.turns)
      .add("events", tape.events);
}

}  // namespace

Result<void> TextDiffPrinter::begin(const DiffTitle& title, const TapeDiff& diff) {
  const std::string one = printable_line(title.one);
  const std::string other = printable_line(title.other);
  const Color color = diff.equal() ? Color::good : Color::doubtful;
  fmt::print(out_, "{}{}{}: {}\n", color_begin(color, colors_), diff.equal() ? "same" : "different",
             color_end(colors_), diff.equal() ? one + " and " + other : counts_text(diff));
  fmt::print(out_, "  - {}: {}\n  + {}: {}\n  {}\n", one, holdings_text(diff.one), other,
             holdings_text(diff.other), agreement_text(diff, title.margin));
  return {};
}

Result<void> TextDiffPrinter::difference(const ShownDifference& difference) {
  const DiffKind kind = difference.what.kind;
  fmt::print(out_, "{}{:<8}{} {}\n", color_begin(diff_color(kind), colors_), to_string(kind),
             color_end(colors_), headline_of(difference));
  constexpr std::size_t head = 24;  // columns before the bytes, and around them
  const std::size_t columns = width_ > head + 8 ? width_ - head : 8;
  for (const DifferenceLine& line : lines_of(difference, columns)) print(line);
  return {};
}

void TextDiffPrinter::print(const DifferenceLine& line) {
  const Color color = line.of_other ? Color::good : Color::bad;
  fmt::print(out_, "  {}{} ", color_begin(color, colors_), line.of_other ? '+' : '-');
  if (line.what == 'e') {
    out_ << line.text;
  } else {
    const std::string_view more = line.cut ? "..." : "";
    fmt::print(out_, "{} {:>6}  \"{}\"{}  {}{}", line.what, line.offset, to_printable(line.bytes), more,
               to_hex(line.bytes), more);
  }
  out_ << color_end(colors_) << '\n';
}

Result<void> TextDiffPrinter::end(std::uint64_t more) {
  if (more > 0) fmt::print(out_, "... and {} more; --all shows them\n", more);
  return {};
}

Result<void> JsonDiffPrinter::begin(const DiffTitle& title, const TapeDiff& diff) {
  JsonObject counts;
  for (std::size_t i = 0; i < kTapeDifferenceKinds; ++i)
    counts.add(to_string(static_cast<DiffKind>(i)), diff.counts.at(i));
  JsonObject json;
  json.add_raw("same", diff.equal() ? "true" : "false")
      .add("one", compared_json(title.one, diff.one))
      .add("other", compared_json(title.other, diff.other))
      .add("same_turns", diff.same)
      .add_or_null("margin_us", title.margin ? std::optional(title.margin->count()) : std::nullopt)
      .add_raw("events_compared", diff.events ? "true" : "false")
      .add("counts", counts);
  out_ << json.str() << '\n';
  return {};
}

Result<void> JsonDiffPrinter::difference(const ShownDifference& difference) {
  const TapeDifference& what = difference.what;
  JsonObject json;
  json.add("kind", to_string(what.kind));
  if (what.kind == DiffKind::slower || what.kind == DiffKind::faster)
    json.add("time", what.time == TapeDifference::Time::answer ? "answer" : "wait");
  add_turn(json, "one", difference.one);
  add_turn(json, "other", difference.other);
  if (what.kind == DiffKind::changed && !difference.one->is_event()) {
    if (const auto at = first_difference(*difference.one, *difference.other)) {
      const auto side = [&](const Turn& turn) {
        return hex_around(at->written ? turn.writes : turn.reads, at->offset);
      };
      json.add("dir", at->written ? "w" : "r")
          .add("offset", at->offset)
          .add("one_hex", side(*difference.one))
          .add("other_hex", side(*difference.other));
    }
  }
  out_ << json.str() << '\n';
  return {};
}

Result<void> JsonDiffPrinter::end(std::uint64_t) { return {}; }

}  // namespace porttape
