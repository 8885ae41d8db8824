// `porttape redact`: a tape without its secrets.

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <random>
#include <string>
#include <utility>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/taped/redact_tape.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/report_place.hpp"
#include "libport/taped/rules_file.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/spool.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

using Where = TapeRedaction::Where;

constexpr VerbHelp kRedactHelp{
    "redact", "TAPE --rules FILE (-o NAME | --dry-run)",
    "Makes a tape of another without its secrets: what the [[redact]] tables of a rules file say\n"
    "(texts, patterns, parts of frames, ranges of bytes; libport/rules/RULES.md) is replaced by\n"
    "fillers of the same length, the same secret everywhere by the same one. Blocks and times\n"
    "stay; checksums of the file's frames follow. Texts of events and of the header are looked\n"
    "through too; what cannot be replaced there (a number, the name of a key) is warned of. Look at\n"
    "what is left before you give a tape away. Exit status: 0 done (a rule that finds nothing is\n"
    "warned of), 1 the tape is damaged or a file cannot be read or written, 2 wrong use.\n",
    "  porttape redact laser.log --rules secrets.rules --dry-run\n"
    "  porttape redact laser.log --rules secrets.rules --identity -o clean\n"};

std::string_view where_text(Where where) {
  switch (where) {
    case Where::read:
      return "r";
    case Where::write:
      return "w";
    case Where::event:
      return "e";
    case Where::header:
      break;
  }
  return "header";
}

std::string place_of(const TapeRedaction& redaction) {
  const std::string time =
      redaction.where == Where::header ? "" : seconds_number(to_us(redaction.at)) + " s ";
  const std::string key = redaction.key.empty() ? "" : in_quotes(redaction.key) + " ";
  return fmt::format("{} {}{}byte {}", where_text(redaction.where), time, key, redaction.offset);
}

std::string name_of_rule(const RuleSet& rules, int number) {
  return number < 0 ? "checksum" : rules.redactions[static_cast<std::size_t>(number)].name.in_quotes();
}

JsonObject json_of(const RuleSet& rules, const TapeRedaction& redaction) {
  JsonObject object;
  object.add("dir", where_text(redaction.where));
  if (redaction.where != Where::header) object.add("t_us", to_us(redaction.at));
  if (!redaction.key.empty()) object.add("key", redaction.key);
  object.add("offset", redaction.offset).add("length", redaction.length);
  if (redaction.rule < 0) return object.add_raw("rule", "null");
  return object.add("rule", rules.redactions[static_cast<std::size_t>(redaction.rule)].name);
}

std::string_view word_for(FixedText what) {
  switch (what) {
    case FixedText::number:
      return "number";
    case FixedText::key:
      return "key";
    case FixedText::kind:
      break;
  }
  return "kind";
}

JsonObject json_of(const RuleSet& rules, const UnredactedText& left) {
  JsonObject object;
  object.add("dir", where_text(left.where));
  if (left.where != Where::header) object.add("t_us", to_us(left.first));
  return object.add("what", word_for(left.what))
      .add("key", left.key)
      .add("rule", rules.redactions[static_cast<std::size_t>(left.rule)].name)
      .add("count", left.count);
}

// All that was replaced, as JSON, with the sums behind it.
class RedactionReport {
 public:
  explicit RedactionReport(const RuleSet& rules) : rules_(rules) {
    spool_.add("{\"format\":\"porttape-redaction\",\"version\":1,\"changes\":[");
  }

  void add(const TapeRedaction& redaction) {
    spool_.add(std::exchange(any_, true) ? ",\n" : "\n");
    spool_.add(json_of(rules_, redaction).str());
  }
  void end(const RedactedTape& tape, const TapePaths& from, bool dry_run, bool identity) {
    JsonList uses;
    for (std::size_t i = 0; i < tape.rules.size(); ++i) {
      uses.add(JsonObject()
                   .add("rule", rules_.redactions[i].name)
                   .add("line", rules_.redactions[i].line.number)
                   .add("count", tape.rules[i].count)
                   .add("bytes", tape.rules[i].bytes));
    }
    JsonList left;
    for (const UnredactedText& each : tape.left) left.add(json_of(rules_, each));
    spool_.add("\n],");
    spool_.add(JsonObject()
                   .add("tape", dry_run ? from.file_name() : tape.paths.file_name())
                   .add_raw("dry_run", dry_run ? "true" : "false")
                   .add("rules", uses)
                   .add("left", left)
                   .add("checksums_mended", tape.follows.count)
                   .add("checksums_left_wrong", tape.wrong_checksums)
                   .add_raw("identity_removed", identity ? "true" : "false")
                   .str()
                   .substr(1));
    spool_.add("\n");
  }
  Result<std::string_view> text() { return spool_.text(); }

 private:
  const RuleSet& rules_;
  Spool spool_;
  bool any_ = false;
};

void tell_rules(const RedactedTape& tape, const RuleSet& rules, bool colors, std::ostream& out) {
  for (std::size_t i = 0; i < tape.rules.size(); ++i) {
    const RedactRule& rule = rules.redactions[i];
    const RedactedTape::Use& use = tape.rules[i];
    fmt::print(out, "  {}:{}: {}: ", printable_line(rules.file), rule.line.number, rule.name.in_quotes());
    if (use.count == 0) {
      fmt::print(out, "{}never found{}\n", color_begin(Color::bad, colors), color_end(colors));
      continue;
    }
    fmt::print(out, "{}, {}, first {}\n", counted(use.count, "time"), counted(use.bytes, "byte"),
               printable_line(place_of(*use.first)));
  }
  if (tape.follows.count > 0)
    fmt::print(out, "  {} of frames mended\n", counted(tape.follows.count, "checksum"));
}

void tell_redacted(const RedactedTape& tape, const TapePaths& from, const RuleSet& rules, bool dry_run,
                   bool colors, std::ostream& out) {
  std::uint64_t count = 0;
  for (const RedactedTape::Use& use : tape.rules) count += use.count;
  if (dry_run) {
    fmt::print(out, "{}: {} would be replaced; nothing was made\n", printable_line(from.name()),
               counted(count, "secret"));
  } else {
    fmt::print(out, "{}: {}, {} replaced\n", printable_line(tape.paths.name()), printable_line(from.name()),
               counted(count, "secret"));
  }
  tell_rules(tape, rules, colors, out);
  if (tape.identity_gone) out << "  host, boot and the device's identity are left out\n";
  if (tape.torn_tail) fmt::print(out, "  note  {}\n", printable_line(*tape.torn_tail));
}

void warn(const RedactedTape& tape, const RuleSet& rules, std::ostream& err) {
  for (std::size_t i = 0; i < tape.rules.size(); ++i) {
    if (tape.rules[i].count > 0) continue;
    fmt::print(err, "porttape redact: warning: {}:{}: [[redact]] {} is found nowhere on the tape\n",
               printable_line(rules.file), rules.redactions[i].line.number,
               rules.redactions[i].name.in_quotes());
  }
  for (const UnredactedText& left : tape.left) {
    const RedactRule& rule = rules.redactions[static_cast<std::size_t>(left.rule)];
    const bool header = left.where == Where::header;
    const std::string when =
        header ? "" : fmt::format(" at {} s, {} in all", seconds_number(to_us(left.first)), left.count);
    const std::string_view what = left.what == FixedText::number ? "the number"
                                  : left.what == FixedText::key  ? "the name of the key"
                                                                 : "an event's kind,";
    fmt::print(err, "porttape redact: warning: {}:{}: {} is found in the {}{} in {} {}; it stays\n",
               printable_line(rules.file), rule.line.number, rule.name.in_quotes(),
               header ? "header" : "events", when, what, in_quotes(left.key));
  }
  if (tape.wrong_checksums > 0)
    fmt::print(err,
               "porttape redact: warning: {} with something replaced had a wrong checksum before; it stays\n",
               counted(tape.wrong_checksums, "frame"));
}

Filler::Key random_key() {
  std::random_device device;
  const auto word = [&device] { return std::uint64_t{device()} << 32U | device(); };
  return {word(), word()};
}

struct RedactRequest {
  TapePaths from;
  NewTapeName to;
  RuleSet rules;
  std::optional<std::string> report;
  bool dry_run = false;
  bool overwrite = false;
};

bool report_is_on_stdout(const RedactRequest& request) {
  return request.report && is_same_report_place(*request.report, "-");
}

Result<RedactRequest> read_request(const CommandLine& line) {
  RedactRequest request;
  request.dry_run = line.has("dry-run");
  request.overwrite = line.has("overwrite");
  if (request.dry_run && line.has("output"))
    return make_error(Errc::usage, "options 'dry-run' and 'output' do not go together; choose one");
  if (!request.dry_run) {
    Result<NewTapeName> to = read_new_tape(line);
    if (!to) return to.error();
    request.to = std::move(*to);
  }
  const auto file = line.text("rules");
  if (!file)
    return make_error(Errc::usage, "option 'rules' is missing: --rules FILE, which says what is secret");
  Result<TapePaths> from = the_tape(line);
  if (!from) return from.error();
  request.from = std::move(*from);
  Result<RuleSet> rules = read_rules_file(*file);
  if (!rules) return rules.error();
  if (rules->redactions.empty() && !line.has("identity"))
    return make_error(Errc::usage,
                      fmt::format("rules file {} has no [[redact]]: nothing is secret", in_quotes(*file)));
  request.rules = std::move(*rules);
  request.report = line.text("report");
  if (report_is_on_stdout(request) && line.has("json"))
    return make_error(Errc::usage, "both the report and --json would go to stdout; one of them is enough");
  return request;
}

Result<void> check_places(const RedactRequest& request) {
  if (!request.dry_run) {
    if (const auto free = check_new_tape(request.to.paths, request.to.writer); !free) return free;
  }
  if (!request.report) return {};
  for (const TapePaths* const tape : {&request.from, &request.to.paths}) {
    if (const auto apart = check_report_apart(*request.report, *tape); !apart) return apart;
  }
  if (const auto place = check_report_place(*request.report); !place) return place;
  return check_report_free(*request.report, request.overwrite, request.rules.file);
}

}  // namespace

int run_redact(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kRedactHelp);
  line.value("rules", "FILE", "what is secret: its [[redact]] tables")
      .flag("identity", "leave out host, boot and the device's identity, too")
      .flag("dry-run", "only say what would be replaced, each of it")
      .value("report", "FILE",
             "all that was replaced, where and by which rule, as JSON; replaces a file only with --overwrite")
      .flag("json", "that report on stdout");
  add_new_tape_options(line);
  line.color();
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<RedactRequest> request = read_request(line);
  if (!request) return line.usage_error(err, request.error().message);
  if (const auto possible = check_places(*request); !possible)
    return fail_verb("redact", possible.error(), out, err);
  const bool json = line.has("json");
  // Data alone on stdout.
  std::ostream& told = report_is_on_stdout(*request) ? err : out;
  RedactionReport report(request->rules);
  Progress progress(err, "redact", size_of_tape(request->from));
  const auto on_redaction = [&](const TapeRedaction& redaction) {
    if (json || request->report) report.add(redaction);
    if (request->dry_run && !json)
      told << printable_line(place_of(redaction)) << ", " << counted(redaction.length, "byte") << ": "
           << printable_line(name_of_rule(request->rules, redaction.rule)) << '\n';
  };
  const ModeOfSources mode(request->from);
  const Result<RedactedTape> tape = redact_tape(request->from, request->to.paths,
                                                {.rules = request->rules,
                                                 .key = random_key(),
                                                 .identity = line.has("identity"),
                                                 .dry_run = request->dry_run,
                                                 .writer = request->to.writer,
                                                 .progress = [&](std::uint64_t bytes) { progress.at(bytes); },
                                                 .on_redaction = on_redaction});
  progress.clear();
  if (!tape) return fail_verb("redact", tape.error(), out, err);
  report.end(*tape, request->from, request->dry_run, line.has("identity"));
  const Result<std::string_view> text = report.text();
  if (!text) return fail_verb("redact", text.error(), out, err);
  if (json) {
    out << *text;
  } else {
    tell_redacted(*tape, request->from, request->rules, request->dry_run, line.colors(told), told);
  }
  warn(*tape, request->rules, err);
  if (!request->report) return exit_status::kPass;
  if (const auto written = write_report(*request->report, *text); !written)
    return fail_verb("redact", written.error(), out, err);
  return exit_status::kPass;
}

}  // namespace porttape
