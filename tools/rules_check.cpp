#include "libport/rules/rules_check.hpp"

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <string>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/taped/rules_file.hpp"
#include "tools/command_line.hpp"
#include "tools/rules_verbs.hpp"
#include "tools/text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kShown = 48;  // bytes of a frame

constexpr VerbHelp kRulesCheckHelp{
    "rules check", "TAPE RULES",
    "Reads a rules file (libport/rules/RULES.md) and a tape, and says of each rule how often it is about\n"
    "something that the driver wrote, where first and what that is; which rules overlap there; and how many\n"
    "frames no rule is about, and bytes that are in no frame: these are compared byte by byte. Exit status: "
    "0\n"
    "each rule is about something and none overlap, 3 otherwise, 2 the rules are wrong or there is no such\n"
    "tape, 1 the tape is damaged.\n",
    "  porttape rules check laser.log laser.rules\n"
    "  porttape rules check --json laser.log laser.rules\n"};

std::string place_text(const RulesReport::Place& place) {
  return fmt::format("exchange {}, {} s, byte {} of the writes", place.exchange,
                     seconds_number(to_us(place.at)), place.offset);
}

std::string excerpt(const RulesReport::Use& use) {
  const bool whole = use.span == FrameSpan{0, use.frame.size()};
  std::string text = text_and_hex(use.frame, kShown);
  if (!whole)
    text = text_and_hex(use.span.of(use.frame), kShown) + " in " +
           fmt::format("\"{}\"", to_printable(ByteView(use.frame).first(std::min(use.frame.size(), kShown))));
  return text;
}

void print_use(std::ostream& out, const std::string& title, const RulesReport::Use& use, bool colors) {
  if (use.count == 0) {
    out << title << ": " << color_begin(Color::bad, colors) << "never matched" << color_end(colors) << '\n';
    return;
  }
  out << title << ": " << counted(use.count, "time") << ", first " << place_text(use.first) << "\n  "
      << excerpt(use) << '\n';
}

std::string title_of(std::string_view kind, const StrangerText& name, const RuleLine& line,
                     const std::string& file) {
  return fmt::format("{}:{}: {} {}", printable_line(file), line.number, kind, name.in_quotes());
}

void print_formats(std::ostream& out, const RulesReport& report) {
  for (const RulesReport::Format& format : report.formats) {
    if (format.frames == 0) continue;
    out << "frames of " << format.name.in_quotes() << ": " << format.frames;
    if (format.checksum_held + format.checksum_wrong > 0)
      out << ", checksum right in " << format.checksum_held << " and wrong in " << format.checksum_wrong;
    out << '\n';
  }
}

void print_rest(std::ostream& out, const RulesReport& report) {
  if (report.untouched.count > 0) {
    out << counted(report.untouched.count, "frame") << " no rule is about (compared as recorded), first "
        << place_text(report.untouched.first) << "\n  " << excerpt(report.untouched) << '\n';
  }
  if (report.unframed.count > 0) {
    out << counted(report.unframed.count, "byte") << " in no frame (compared as recorded), first "
        << place_text(report.unframed.first) << "\n  " << excerpt(report.unframed) << '\n';
  }
}

void print(std::ostream& out, const RulesReport& report, const RuleSet& set, bool colors) {
  print_formats(out, report);
  for (std::size_t i = 0; i < set.rules.size(); ++i)
    print_use(out, title_of("rule", set.rules[i].name, set.rules[i].line, set.file), report.rules[i], colors);
  for (std::size_t i = 0; i < set.replies.size(); ++i)
    print_use(out, title_of("reply", set.replies[i].name, set.replies[i].line, set.file), report.replies[i],
              colors);
  for (const RulesReport::Overlap& overlap : report.overlaps) {
    const Rule& one = set.rules[static_cast<std::size_t>(overlap.one)];
    const Rule& other = set.rules[static_cast<std::size_t>(overlap.other)];
    out << title_of("rule", other.name, other.line, set.file) << ' ' << color_begin(Color::bad, colors)
        << "overlaps" << color_end(colors) << " rule " << one.name.in_quotes() << " (line " << one.line.number
        << "), which goes before it: " << counted(overlap.use.count, "time") << ", first "
        << place_text(overlap.use.first) << '\n';
  }
  print_rest(out, report);
}

JsonObject json_of(const RulesReport::Use& use) {
  JsonObject object;
  object.add("count", use.count);
  if (use.count == 0) return object.add_raw("first", "null");
  return object.add("first", JsonObject()
                                 .add("t_us", to_us(use.first.at))
                                 .add("offset", use.first.offset)
                                 .add("exchange", use.first.exchange)
                                 .add("frame_hex", to_hex(use.frame))
                                 .add("begin", use.span.begin)
                                 .add("end", use.span.end));
}

template <class Item>
JsonList uses(const std::vector<Item>& items, const std::vector<RulesReport::Use>& found) {
  JsonList list;
  for (std::size_t i = 0; i < items.size(); ++i) {
    list.add(JsonObject()
                 .add("name", items[i].name)
                 .add("line", items[i].line.number)
                 .add("use", json_of(found[i])));
  }
  return list;
}

std::string json_of(const RulesReport& report, const RuleSet& set, const std::string& tape) {
  JsonList formats;
  for (const RulesReport::Format& format : report.formats) {
    formats.add(JsonObject()
                    .add("name", format.name)
                    .add("frames", format.frames)
                    .add("checksum_held", format.checksum_held)
                    .add("checksum_wrong", format.checksum_wrong));
  }
  JsonList overlaps;
  for (const RulesReport::Overlap& overlap : report.overlaps) {
    overlaps.add(JsonObject()
                     .add("rule", set.rules[static_cast<std::size_t>(overlap.one)].name)
                     .add("other", set.rules[static_cast<std::size_t>(overlap.other)].name)
                     .add("use", json_of(overlap.use)));
  }
  return JsonObject()
      .add("tape", tape)
      .add("file", set.file)
      .add_raw("ok", report.any_trouble() ? "false" : "true")
      .add("frames", report.frames)
      .add("formats", formats)
      .add("rules", uses(set.rules, report.rules))
      .add("replies", uses(set.replies, report.replies))
      .add("overlaps", overlaps)
      .add("untouched", json_of(report.untouched))
      .add("unframed_bytes", json_of(report.unframed))
      .str();
}

Result<RulesReport> check(const TapePaths& tape, const RuleBook& book) {
  Result<TapeReader> reader = TapeReader::open(tape);
  if (!reader) return reader.error();
  RulesCheck check(book);
  while (true) {
    const Result<std::optional<Record>> record = reader->next();
    if (!record) return record.error();
    if (!*record) return check.finish();
    check.pass(**record);
  }
}

int fail(std::ostream& out, std::ostream& err, const Error& error) {
  out.flush();
  err << "porttape rules check: " << printable_lines(error.message) << '\n';
  return exit_status_of(error.code);
}

}  // namespace

int run_rules_check(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kRulesCheckHelp);
  line.flag("json", "prints one JSON object (OUTPUT.md has its keys)");
  line.color();
  line.takes_words();
  if (const auto done = line.parse(args, out, err)) return *done;
  if (line.words().size() != 2) return line.usage_error(err, "takes a tape and a rules file: TAPE RULES");
  const auto tape = find_tape(line.words()[0]);
  if (!tape) return fail(out, err, tape.error());
  Result<RuleSet> rules = read_rules_file(line.words()[1]);
  if (!rules) return fail(out, err, rules.error());
  const RuleBook book(std::move(*rules));
  const Result<RulesReport> report = check(*tape, book);
  if (!report) return fail(out, err, report.error());
  if (line.has("json")) {
    out << json_of(*report, book.set(), tape->name()) << '\n';
  } else {
    print(out, *report, book.set(), line.colors(out));
  }
  return report->any_trouble() ? exit_status::kDataMismatch : exit_status::kPass;
}

}  // namespace porttape
