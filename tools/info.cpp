#include <algorithm>
#include <iomanip>

#include "libport/base/printable.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tools/command_line.hpp"
#include "tools/json_object.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kHelp{
    "info", "TAPE... [--json]",
    "Says what tapes hold: times, blocks, bytes and rates of both directions, exchanges and how\n"
    "long the device took to answer, events, gaps, damage. Rates are over the whole tape. Exit\n"
    "status: 0, 1 a tape is damaged or cannot be read, 2 one is not a tape or not there.\n",
    "  porttape info laser.log\n"
    "  porttape info --json *.logr | jq .latency_us.p99\n"};

std::optional<std::int64_t> us_of(const std::optional<TapeTime>& time) {
  if (!time) return std::nullopt;
  return to_us(*time);
}

std::optional<std::string> message_of(const std::optional<Error>& error) {
  if (!error) return std::nullopt;
  return error->message;
}

std::string number_json(double value) {
  std::string text = std::to_string(value);
  return text.find_first_not_of("0123456789.-") == std::string::npos ? text : "null";
}

std::string to_json(const FileSummary& file, Micros duration) {
  if (!file.exists) return "null";
  const auto us = static_cast<double>(duration.count());
  JsonObject json;
  json.add("file", file.path)
      .add("file_bytes", file.file_bytes)
      .add("blocks", file.blocks)
      .add("bytes", file.bytes)
      .add("largest_block", file.largest_block)
      .add_or_null("first_us", us_of(file.first))
      .add_or_null("last_us", us_of(file.last))
      .add_raw("bytes_per_s", us > 0 ? number_json(static_cast<double>(file.bytes) * 1e6 / us) : "null")
      .add("torn_bytes", file.torn_bytes)
      .add_or_null("damage", message_of(file.damage));
  return json.str();
}

std::string to_json(const EventsSummary& events) {
  if (!events.exists) return "null";
  JsonObject kinds;
  for (const auto& [kind, count] : events.kinds) kinds.add(kind, count);
  const TapeHeader header = events.header.value_or(TapeHeader{});
  JsonObject json;
  json.add("file", events.path)
      .add("created", header.created)
      .add("device", header.device)
      .add("driver", header.driver)
      .add("host", header.host)
      .add("tool", header.tool)
      .add_raw("kinds", kinds.str())
      .add("gap_bytes", events.gap_bytes)
      .add_raw("torn", events.torn_tail ? "true" : "false")
      .add_or_null("damage", message_of(events.damage));
  return json.str();
}

std::string to_json(const std::optional<LatencySummary>& latency) {
  if (!latency) return "null";
  JsonObject json;
  json.add("min", latency->min_us)
      .add("median", latency->median_us)
      .add("p99", latency->p99_us)
      .add("max", latency->max_us);
  return json.str();
}

void print_json(const TapeSummary& tape, std::ostream& out) {
  JsonObject json;
  json.add("tape", tape.name)
      .add("layout", to_string(tape.layout))
      .add("duration_us", tape.duration().count())
      .add_raw("read", to_json(tape.read, tape.duration()))
      .add_raw("write", to_json(tape.write, tape.duration()))
      .add("exchanges", tape.exchanges)
      .add("answered", tape.answered)
      .add_raw("latency_us", to_json(tape.latency))
      .add_raw("events", to_json(tape.events))
      .add_raw("sound", tape.damages().empty() ? "true" : "false");
  out << json.str() << '\n';
}

std::ostream& label(std::ostream& out, std::string_view name) {
  return out << "  " << std::left << std::setw(11) << name;
}

void print_file(const FileSummary& file, std::string_view name, Micros duration, std::ostream& out) {
  label(out, name);
  if (!file.exists) {
    out << "no file\n";
    return;
  }
  out << file.blocks << " blocks, " << file.bytes << " bytes";
  if (file.first && file.last) {
    out << ", " << seconds_text(to_us(*file.first)) << " to " << seconds_text(to_us(*file.last)) << " s, "
        << rate_text(file.bytes, duration.count()) << ", largest block " << file.largest_block;
  }
  out << '\n';
}

// A header comes from a file that anyone may have written: nothing of it may reach a terminal raw.
std::string safe(std::string_view text) { return printable_line(text); }

void print_events(const EventsSummary& events, std::ostream& out) {
  if (!events.exists) return;
  if (events.header) {
    label(out, "recorded") << safe(events.header->created) << " by " << safe(events.header->tool) << " on "
                           << safe(events.header->host) << '\n';
    label(out, "device") << safe(events.header->device) << '\n';
    label(out, "driver") << safe(events.header->driver) << '\n';
  }
  label(out, "events");
  std::string_view separator;
  for (const auto& [kind, count] : events.kinds) {
    out << separator << count << ' ' << safe(kind);
    separator = ", ";
  }
  out << (events.kinds.empty() ? "none\n" : "\n");
  if (events.count("gap") > 0) {
    label(out, "gaps") << events.count("gap") << ", " << events.gap_bytes << " bytes missing\n";
  }
}

void print_text(const TapeSummary& tape, std::ostream& out) {
  out << safe(tape.name) << '\n';
  label(out, "layout") << to_string(tape.layout) << '\n';
  label(out, "duration") << seconds_text(tape.duration().count()) << " s\n";
  print_file(tape.read, "read", tape.duration(), out);
  print_file(tape.write, "write", tape.duration(), out);
  label(out, "exchanges") << tape.exchanges << ", " << tape.answered << " answered\n";
  if (tape.latency) {
    label(out, "answers") << "after " << span_text(tape.latency->min_us) << " to "
                          << span_text(tape.latency->max_us) << ", median "
                          << span_text(tape.latency->median_us) << ", p99 " << span_text(tape.latency->p99_us)
                          << '\n';
  }
  print_events(tape.events, out);
  for (const std::string& note : tape.torn_tails()) label(out, "note") << safe(note) << '\n';
  for (const Error& damage : tape.damages()) label(out, "damage") << safe(damage.message) << '\n';
}

int info_of(const std::string& argument, bool json, std::ostream& out, std::ostream& err) {
  const auto paths = find_tape(argument);
  const auto summary = paths ? summarize(*paths) : Result<TapeSummary>(paths.error());
  if (!summary) {
    out.flush();
    err << "porttape info: " << safe(summary.error().message) << '\n';
    return exit_status_of(summary.error().code);
  }
  json ? print_json(*summary, out) : print_text(*summary, out);
  return summary->damages().empty() ? exit_status::kPass : exit_status::kRuntime;
}

}  // namespace

int run_info(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kHelp);
  line.flag("json", "one JSON object a tape and line (tools/OUTPUT.md)");
  if (const auto done = line.parse(args, out, err)) return *done;
  int worst = exit_status::kPass;
  for (const std::string& tape : line.tapes())
    worst = std::max(worst, info_of(tape, line.has("json"), out, err));
  return worst;
}

}  // namespace porttape
