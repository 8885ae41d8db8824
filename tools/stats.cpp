// `porttape stats`: how a conversation went, in numbers.

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <utility>

#include "libport/base/json_object.hpp"
#include "libport/base/printable.hpp"
#include "libport/rules/framing.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/taped/rules_file.hpp"
#include "libport/taped/tape_stats.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kStatsHelp{
    "stats", "TAPE [--protocol NAME | --rules FILE] [--exchanges] [--json]",
    "Says how a conversation went: how long the device took to answer and which exchanges were the\n"
    "slowest, the busiest second of each direction, silent periods, and of each command how often it\n"
    "was sent and how it was answered. Commands are told apart by the frames of a protocol or of a\n"
    "rules file (libport/rules/RULES.md), then what the device says is counted too; else by how the\n"
    "writes of an exchange begin. Unanswered is what nothing was read behind before the next one.\n"
    "Exit status: 0, 1 the tape is damaged or cannot be read, 2 wrong use, no such tape.\n",
    "  porttape stats laser.log --protocol scip\n"
    "  porttape stats gps.log --protocol nmea --silence 2\n"
    "  porttape stats laser.log --exchanges --json | jq 'select(.answer_us > 50000)'\n"};

constexpr std::size_t kCommandsShown = 20;

struct StatsPlan {
  TapePaths tape;
  TapeStatsOptions options;
};

std::string known_protocols() {
  std::string all;
  for (const std::string_view name : protocol_names()) all += (all.empty() ? "" : ", ") + std::string(name);
  return all;
}

Result<std::vector<FrameFormat>> read_formats(const CommandLine& line) {
  const auto protocol = line.text("protocol");
  const auto rules = line.text("rules");
  if (protocol && rules)
    return make_error(Errc::usage, "--protocol and --rules: one of them says what a frame is");
  if (protocol) {
    std::vector<FrameFormat> formats = protocol_formats(*protocol);
    if (!formats.empty()) return formats;
    return make_error(Errc::usage, fmt::format("option 'protocol': {} is not known; it is one of {}; another "
                                               "is described in a rules file",
                                               in_quotes(*protocol), known_protocols()));
  }
  if (!rules) return std::vector<FrameFormat>{};
  Result<RuleSet> set = read_rules_file(*rules);
  if (!set) return set.error();
  if (set->frames.empty())
    return make_error(Errc::usage,
                      fmt::format("rules {} say nothing of frames; a [[frame]] does", in_quotes(*rules)));
  return std::move(set->frames);
}

Result<StatsPlan> read_stats_plan(const CommandLine& line) {
  StatsPlan plan;
  Result<TapePaths> tape = the_tape(line);
  if (!tape) return tape.error();
  plan.tape = std::move(*tape);
  Result<std::vector<FrameFormat>> formats = read_formats(line);
  if (!formats) return formats.error();
  plan.options.formats = std::move(*formats);
  const auto silence = line.text("silence");
  if (!silence) return plan;
  const auto seconds = parse_seconds(*silence);
  if (!seconds || to_us(*seconds) == 0)
    return make_error(Errc::usage, fmt::format("option 'silence': {} is no time; it is in seconds, e.g. 0.5",
                                               in_quotes(*silence)));
  plan.options.silence = *seconds - TapeTime{};
  return plan;
}

std::string spans_text(const SpanStats& spans) {
  return fmt::format("after {} to {}, median {}, p90 {}, p99 {}", span_text(spans.min_us),
                     span_text(spans.max_us), span_text(spans.median_us), span_text(spans.p90_us),
                     span_text(spans.p99_us));
}

void print_direction(std::ostream& out, std::string_view name, const DirectionStats& stats,
                     const TapeStats& all) {
  fmt::print(out, "  {:<11}{} bytes in {} blocks, {}", name, stats.bytes, stats.blocks,
             rate_text(stats.bytes, all.duration.count()));
  if (stats.bytes > 0)
    fmt::print(out, ", busiest second {} bytes at {} s", stats.busiest_bytes,
               to_us(stats.busiest) / 1'000'000);
  if (stats.stray > 0) fmt::print(out, ", {} bytes in no frame", stats.stray);
  out << '\n';
}

void print_silences(std::ostream& out, const TapeStats& stats, Micros least) {
  fmt::print(out, "  {:<11}{} of {} or longer", "silences", stats.silences, span_text(least.count()));
  if (stats.silences > 0) fmt::print(out, ", {} in all; the longest:", span_text(stats.silent.count()));
  out << '\n';
  for (const Silence& each : stats.longest_silences)
    fmt::print(out, "  {:<11}{} from {} s on\n", "", span_text(each.length.count()),
               seconds_number(to_us(each.from)));
}

std::string span_or_none(std::uint64_t count, std::int64_t us) { return count > 0 ? span_text(us) : "-"; }

// Answers to what is written; of what is read, from one to the next.
void print_commands(std::ostream& out, const std::vector<CommandStats>& commands, bool written, bool all) {
  if (commands.empty()) return;
  fmt::print(out, "\n  {:<24} {:>9} {:>11} {:>10} {:>9} {:>9} {:>9}  {}\n", written ? "written" : "read",
             "count", "bytes", written ? "unanswered" : "", written ? "median" : "every", "p99", "max",
             "the max at");
  const std::size_t shown = all ? commands.size() : std::min(commands.size(), kCommandsShown);
  for (const CommandStats& each :
       std::vector(commands.begin(), commands.begin() + static_cast<std::ptrdiff_t>(shown))) {
    const std::string at = each.longest ? seconds_number(to_us(*each.longest)) + " s" : "";
    const std::string row =
        fmt::format("  {:<24} {:>9} {:>11} {:>10} {:>9} {:>9} {:>9}  {}", printable_line(each.command),
                    each.count, each.bytes, written ? std::to_string(each.unanswered) : "",
                    span_or_none(each.spans.count, each.spans.median_us),
                    span_or_none(each.spans.count, each.spans.p99_us),
                    span_or_none(each.spans.count, each.spans.max_us), at);
    out << row.substr(0, row.find_last_not_of(' ') + 1) << '\n';
  }
  if (shown < commands.size())
    fmt::print(out, "  ... and {} more; --all shows them\n", commands.size() - shown);
}

void print_slowest(std::ostream& out, const std::vector<TapeExchange>& slowest) {
  if (!slowest.empty()) out << "\n  slowest answers\n";
  for (const TapeExchange& each : slowest) {
    fmt::print(out, "  {:>9}  exchange {} at {} s  {}\n", span_text(each.answer.value_or(Micros{}).count()),
               each.number, seconds_number(to_us(each.at)), printable_line(each.command));
  }
}

void print_stats(std::ostream& out, const StatsPlan& plan, const TapeStats& stats, bool all) {
  out << printable_line(plan.tape.file_name()) << '\n';
  fmt::print(out, "  {:<11}{} s\n", "duration", seconds_number(stats.duration.count()));
  fmt::print(out, "  {:<11}{}, {} answered\n", "exchanges", stats.exchanges, stats.answered);
  if (stats.answered > 0) fmt::print(out, "  {:<11}{}\n", "answers", spans_text(stats.answers));
  print_direction(out, "read", stats.read, stats);
  print_direction(out, "write", stats.write, stats);
  print_silences(out, stats, plan.options.silence);
  print_commands(out, stats.write.commands, true, all);
  print_commands(out, stats.read.commands, false, all);
  print_slowest(out, stats.slowest);
}

std::string stats_json(const SpanStats& spans) {
  if (spans.count == 0) return "null";
  return JsonObject()
      .add("min", spans.min_us)
      .add("median", spans.median_us)
      .add("p90", spans.p90_us)
      .add("p99", spans.p99_us)
      .add("max", spans.max_us)
      .str();
}

std::optional<std::int64_t> us_or_none(const std::optional<TapeTime>& at) {
  return at ? std::optional(to_us(*at)) : std::nullopt;
}

JsonObject stats_json(const DirectionStats& stats, bool written) {
  JsonList commands;
  for (const CommandStats& each : stats.commands) {
    JsonObject command;
    command.add("command", each.command).add("count", each.count).add("bytes", each.bytes);
    if (written) command.add("unanswered", each.unanswered);
    commands.add(command.add_raw(written ? "answer_us" : "interval_us", stats_json(each.spans))
                     .add_or_null("longest_at_us", us_or_none(each.longest)));
  }
  return JsonObject()
      .add("blocks", stats.blocks)
      .add("bytes", stats.bytes)
      .add("busiest_second_bytes", stats.busiest_bytes)
      .add("busiest_second_us", to_us(stats.busiest))
      .add("stray_bytes", stats.stray)
      .add("commands", commands);
}

JsonObject stats_json(const TapeExchange& exchange) {
  const auto answer = exchange.answer ? std::optional(exchange.answer->count()) : std::nullopt;
  return JsonObject()
      .add("exchange", exchange.number)
      .add("t_us", to_us(exchange.at))
      .add("until_us", to_us(exchange.until))
      .add_or_null("answer_us", answer)
      .add("written", exchange.written)
      .add("read", exchange.read)
      .add("command", exchange.command);
}

void print_stats_json(std::ostream& out, const StatsPlan& plan, const TapeStats& stats) {
  JsonList silences;
  for (const Silence& each : stats.longest_silences)
    silences.add(JsonObject().add("from_us", to_us(each.from)).add("length_us", each.length.count()));
  JsonList slowest;
  for (const TapeExchange& each : stats.slowest) slowest.add(stats_json(each));
  JsonObject json;
  json.add("tape", plan.tape.file_name())
      .add("duration_us", stats.duration.count())
      .add("exchanges", stats.exchanges)
      .add("answered", stats.answered)
      .add_raw("answer_us", stats_json(stats.answers))
      .add("read", stats_json(stats.read, false))
      .add("write", stats_json(stats.write, true))
      .add("silence_us", plan.options.silence.count())
      .add("silences", stats.silences)
      .add("silent_us", stats.silent.count())
      .add("longest_silences", silences)
      .add("slowest", slowest);
  out << json.str() << '\n';
}

void print_exchange(std::ostream& out, const TapeExchange& exchange, bool json) {
  if (json) {
    out << stats_json(exchange).str() << '\n';
    return;
  }
  const std::string answer = exchange.answer ? span_text(exchange.answer->count()) : "none";
  fmt::print(out, "{:>8}  {:>14}  {:>9}  {:>7}  {:>7}  {}\n", exchange.number,
             seconds_number(to_us(exchange.at)), answer, exchange.written, exchange.read,
             printable_line(exchange.command));
}

}  // namespace

int run_stats(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kStatsHelp);
  const std::string protocols = known_protocols();
  line.value("protocol", "NAME", protocols.c_str())
      .value("rules", "FILE", "whose frames count")
      .value("silence", "S", "seconds of silence that are listed, 1 without it")
      .flag("exchanges",
            "the table of all exchanges instead: number, time, answer after, bytes "
            "written and read, command")
      .flag("all", "every command, else 20")
      .flag("json", "one JSON object, with --exchanges one an exchange and line (tools/OUTPUT.md)");
  if (const auto done = line.parse(args, out, err)) return *done;
  Result<StatsPlan> plan = read_stats_plan(line);
  if (!plan) return line.usage_error(err, plan.error().message);
  const bool json = line.has("json");
  const bool exchanges = line.has("exchanges");
  Progress progress(err, "stats", size_of_tape(plan->tape));
  plan->options.progress = [&](std::uint64_t bytes) { progress.at(bytes); };
  if (exchanges) {
    if (!json)
      fmt::print(out, "{:>8}  {:>14}  {:>9}  {:>7}  {:>7}  {}\n", "exchange", "at, s", "answer", "written",
                 "read", "command");
    plan->options.on_exchange = [&](const TapeExchange& exchange) { print_exchange(out, exchange, json); };
  }
  auto tape = TapeReader::open(plan->tape, {.events_may_fail = true});
  if (!tape) return fail_verb("stats", tape.error(), out, err);
  const Result<TapeStats> stats = count_stats(*tape, plan->options);
  progress.clear();
  if (!stats) return fail_verb("stats", stats.error(), out, err);
  if (json && !exchanges) print_stats_json(out, *plan, *stats);
  if (!json && !exchanges) print_stats(out, *plan, *stats, line.has("all"));
  if (const auto torn = tape->torn_tail()) {
    out.flush();
    err << "porttape stats: note: " << printable_line(*torn) << '\n';
  }
  return exit_status::kPass;
}

}  // namespace porttape
