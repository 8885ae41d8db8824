#include <algorithm>
#include <iomanip>
#include <span>
#include <utility>

#include "libport/base/json_object.hpp"
#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/judgement.hpp"
#include "tools/command_line.hpp"
#include "tools/output.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kInfoHelp{
    "info", "TAPE... [--json]",
    "Says what tapes hold: times, blocks, bytes and rates of both directions, exchanges and how\n"
    "long the device took to answer, sessions, events, gaps, damage. Rates are over the whole\n"
    "tape; a session is from an open of the driver's to its close. Exit status: 0, 1 a tape is damaged or "
    "cannot be read, 2 one is not a tape or not there.\n",
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

std::string_view word_of(Transport transport) {
  return transport == Transport::datagram ? "datagram" : "stream";
}
std::string_view word_of(Stamped stamped) { return stamped == Stamped::arrival ? "arrival" : "read"; }

template <class Text>
std::optional<Text> text_or_none(const Text& text) {
  return text.empty() ? std::nullopt : std::optional(text);
}

std::string to_json(const std::optional<TapeZero>& zero) {
  if (!zero) return "null";
  JsonObject json;
  json.add("wall", zero->wall)
      .add("monotonic_us", zero->monotonic_us)
      .add_or_null("boot", text_or_none(zero->boot));
  return json.str();
}

std::string to_json(const std::optional<PreviousTape>& previous) {
  if (!previous) return "null";
  JsonObject json;
  json.add("id", previous->id).add("name", previous->name);
  return json.str();
}

std::string to_json(const std::optional<TapeOrigin>& origin) {
  if (!origin) return "null";
  JsonList tapes;
  for (const PreviousTape& tape : origin->tapes) {
    JsonObject each;
    tapes.add(each.add_or_null("id", text_or_none(tape.id)).add("name", tape.name));
  }
  const auto from = origin->from ? std::optional(origin->from->count()) : std::nullopt;
  return JsonObject().add("by", origin->by).add("tapes", tapes).add_or_null("from_us", from).str();
}

std::string to_json(const std::optional<PortIdentity>& port) {
  if (!port) return "null";
  const auto id = [](const std::optional<std::uint16_t>& number) {
    return number ? std::optional(usb_id_text(*number)) : std::nullopt;
  };
  JsonObject json;
  json.add("path", port->path)
      .add_or_null("vid", id(port->vid))
      .add_or_null("pid", id(port->pid))
      .add_or_null("serial", text_or_none(port->serial))
      .add_or_null("manufacturer", text_or_none(port->manufacturer))
      .add_or_null("product", text_or_none(port->product))
      .add_or_null("interface", port->interface)
      .add_or_null("driver", text_or_none(port->driver));
  return json.str();
}

JsonList to_json(const std::vector<GapSummary>& gaps) {
  JsonList list;
  for (const GapSummary& gap : gaps) {
    JsonObject json;
    json.add("from_us", to_us(gap.from))
        .add("t_us", to_us(gap.at))
        .add("bytes", gap.bytes)
        .add("why", gap.why);
    list.add(json);
  }
  return list;
}

JsonList to_json(const std::vector<SessionSummary>& sessions) {
  JsonList list;
  for (const SessionSummary& session : sessions) {
    JsonObject json;
    json.add_or_null("open_us", us_of(session.opened))
        .add_or_null("close_us", us_of(session.closed))
        .add("duration_us", session.duration.count())
        .add("read_bytes", session.read_bytes)
        .add("write_bytes", session.write_bytes);
    list.add(json);
  }
  return list;
}

JsonList to_json(const std::vector<MarkSummary>& marks) {
  JsonList list;
  for (const MarkSummary& mark : marks) {
    JsonObject json;
    json.add("t_us", to_us(mark.at)).add("text", mark.text);
    list.add(json);
  }
  return list;
}

// As they are on the tape.
template <class Summary>
JsonList lines_of(const std::vector<Summary>& events) {
  JsonList list;
  for (const auto& [at, what] : events) {
    std::string line = encode(at, what);
    line.pop_back();
    list.add_raw(line);
  }
  return list;
}

JsonList to_json(const std::vector<SignalSummary>& signals) {
  JsonList list;
  for (const auto& [at, what] : signals) {
    std::string line = encode(at, signal_event(what));
    line.pop_back();
    list.add_raw(line);
  }
  return list;
}

JsonList to_json(const std::vector<std::string>& texts) {
  JsonList list;
  for (const std::string& text : texts) list.add(text);
  return list;
}

template <class Counts>
JsonObject counts_of(const Counts& counts) {
  JsonObject json;
  for (const auto& [kind, count] : counts) json.add(kind.raw(), count);
  return json;
}

std::string to_json(const EventsSummary& events) {
  if (!events.exists) return "null";
  const TapeHeader header = events.header.value_or(TapeHeader{});
  JsonObject json;
  json.add("file", events.path)
      .add("created", header.created)
      .add("device", header.device)
      .add("driver", header.driver)
      .add("host", header.host)
      .add("tool", header.tool)
      .add_raw("kinds", counts_of(events.kinds).str())
      .add("gap_bytes", events.gap_bytes)
      .add_raw("torn", events.torn_tail ? "true" : "false")
      .add_or_null("damage", message_of(events.damage))
      .add_or_null("id", text_or_none(header.id))
      .add_raw("zero", to_json(header.zero))
      .add_or_null("transport", header.transport ? std::optional(word_of(*header.transport)) : std::nullopt)
      .add_or_null("stamped", header.stamped ? std::optional(word_of(*header.stamped)) : std::nullopt)
      .add_raw("previous", to_json(header.previous))
      .add_raw("identity", to_json(header.identity))
      .add_or_null("identity_refused", text_or_none(header.identity_refused))
      .add_raw("origin", to_json(header.origin))
      .add("gaps", to_json(events.gaps))
      .add("marks", to_json(events.marks))
      .add("settings", lines_of(events.settings))
      .add("signals", to_json(events.signals))
      .add("faults", lines_of(events.faults))
      .add_raw("fault_kinds", counts_of(events.fault_kinds).str())
      .add_raw("ended", events.ended ? "true" : "false");
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

void print_json(const TapeSummary& tape, const Judgement& judgement, std::ostream& out) {
  JsonObject json;
  json.add("tape", tape.name)
      .add("layout", to_string(tape.layout))
      .add("duration_us", tape.duration().count())
      .add_raw("read", to_json(tape.read, tape.duration()))
      .add_raw("write", to_json(tape.write, tape.duration()))
      .add("exchanges", tape.exchanges)
      .add("answered", tape.answered)
      .add_raw("latency_us", to_json(tape.latency))
      .add("session_count", tape.session_count)
      .add("sessions", to_json(tape.sessions))
      .add_raw("events", to_json(tape.events))
      .add_raw("sound", judgement.sound() ? "true" : "false")
      .add("verdict", to_string(judgement.verdict))
      .add("damages", to_json(judgement.damages))
      .add("notes", to_json(judgement.notes))
      .add_raw("being_written", tape.being_written ? "true" : "false");
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
    out << ", " << seconds_number(to_us(*file.first)) << " to " << seconds_number(to_us(*file.last)) << " s, "
        << rate_text(file.bytes, duration.count()) << ", largest block " << file.largest_block;
  }
  out << '\n';
}

// A header comes from a file that anyone may have written: nothing of it may reach a terminal raw.
std::string safe(std::string_view text) { return printable_line(text); }

void print_origin(const TapeOrigin& origin, std::ostream& out) {
  constexpr std::size_t shown = 5;
  label(out, "origin") << origin.by.for_line() << " of";
  for (std::size_t i = 0; i < std::min(origin.tapes.size(), shown); ++i)
    out << (i == 0 ? " " : ", ") << origin.tapes[i].name.for_line();
  if (origin.tapes.size() > shown) out << " and " << origin.tapes.size() - shown << " more";
  if (origin.from && origin.from->count() > 0)
    out << ", from " << seconds_number(origin.from->count()) << " s on";
  out << '\n';
}

void print_header(const TapeHeader& header, std::ostream& out) {
  label(out, "recorded") << header.created.for_line() << " by " << header.tool.for_line() << " on "
                         << header.host.for_line() << '\n';
  if (!header.id.empty()) label(out, "id") << header.id.for_line() << '\n';
  if (header.zero) {
    label(out, "zero") << header.zero->wall.for_line() << ", " << seconds_number(header.zero->monotonic_us)
                       << " s after the boot";
    if (!header.zero->boot.empty()) out << ' ' << header.zero->boot.for_line();
    out << '\n';
  }
  label(out, "device") << header.device.for_line() << '\n';
  if (header.identity) label(out, "identity") << safe(to_text(*header.identity)) << '\n';
  if (!header.identity_refused.empty())
    label(out, "identity") << "refused: " << header.identity_refused.for_line() << '\n';
  label(out, "driver") << header.driver.for_line() << '\n';
  if (header.transport) label(out, "transport") << word_of(*header.transport) << '\n';
  if (header.stamped) {
    label(out, "stamped") << (*header.stamped == Stamped::arrival ? "when bytes arrived"
                                                                  : "when bytes were read")
                          << '\n';
  }
  if (header.previous) {
    label(out, "previous") << header.previous->name.for_line() << ' ' << header.previous->id.for_line()
                           << '\n';
  }
  if (header.origin) print_origin(*header.origin, out);
}

constexpr std::size_t kSettingsShown = 20;
constexpr std::size_t kSignalsShown = 8;

// The history in short.
// What was done to the line on purpose, and by which plan.
void print_faults(const EventsSummary& events, std::ostream& out) {
  if (events.faults.empty()) return;
  std::string made;
  for (const auto& [kind, count] : events.fault_kinds)
    made += (made.empty() ? "" : ", ") + std::to_string(count) + ' ' + kind.for_line();
  label(out, "faults") << (made.empty() ? "none made" : made) << '\n';
  const LineFault& first = events.faults.front().what.fault;
  if (first.kind == LineFault::kPlan)
    label(out, "") << "by " << first.spec.for_line() << "; seed " << first.seed.value_or(0) << '\n';
}

void print_settings(const EventsSummary& events, std::ostream& out) {
  std::string_view name = "settings";
  for (const auto& [at, what] :
       std::span(events.settings).first(std::min(events.settings.size(), kSettingsShown))) {
    label(out, std::exchange(name, "")) << seconds_number(to_us(at)) << " s  " << settings_text(what) << '\n';
  }
  if (const std::uint64_t all = events.count<event::Settings>(); all > kSettingsShown)
    label(out, name) << "… and " << all - kSettingsShown << " more\n";
}

void print_signals(const EventsSummary& events, std::ostream& out) {
  std::string_view name = "signals";
  for (const auto& [at, what] :
       std::span(events.signals).first(std::min(events.signals.size(), kSignalsShown))) {
    label(out, std::exchange(name, ""))
        << seconds_number(to_us(at)) << " s  " << named_signal_text(what) << '\n';
  }
  const std::uint64_t all = events.count<event::Modem>() + events.count<event::Break>();
  if (all > kSignalsShown) label(out, name) << "… and " << all - kSignalsShown << " more\n";
}

void print_events(const EventsSummary& events, std::ostream& out) {
  if (!events.exists) return;
  if (events.header) print_header(*events.header, out);
  label(out, "events");
  std::string_view separator;
  for (const auto& [kind, count] : events.kinds) {
    out << separator << count << ' ' << kind.for_line();
    separator = ", ";
  }
  out << (events.kinds.empty() ? "none\n" : "\n");
  if (events.count<event::Gap>() > 0) {
    label(out, "gaps") << events.count<event::Gap>() << ", " << events.gap_bytes << " bytes missing\n";
  }
  print_faults(events, out);
  print_settings(events, out);
  print_signals(events, out);
  for (const MarkSummary& mark : events.marks)
    label(out, "mark") << seconds_number(to_us(mark.at)) << " s  " << mark.text.for_line() << '\n';
  if (events.count<event::Mark>() > events.marks.size())
    label(out, "mark") << "… and " << events.count<event::Mark>() - events.marks.size() << " more\n";
  label(out, "ended") << (events.ended ? "yes\n" : "no\n");
}

constexpr std::size_t kSessionsShown = 20;

void print_sessions(const TapeSummary& tape, std::ostream& out) {
  label(out, "sessions") << tape.session_count << '\n';
  std::size_t number = 0;
  for (const SessionSummary& session : tape.sessions) {
    if (++number > kSessionsShown) break;
    const std::int64_t opened = session.opened ? to_us(*session.opened) : 0;
    label(out, "") << std::right << std::setw(2) << number << "  " << seconds_number(opened) << " to "
                   << seconds_number(opened + session.duration.count()) << " s"
                   << (session.closed ? "" : " (no close)") << ", " << span_text(session.duration.count())
                   << ", " << session.read_bytes << " bytes read, " << session.write_bytes << " written\n";
  }
  if (tape.session_count > kSessionsShown)
    label(out, "") << "and " << tape.session_count - kSessionsShown << " more\n";
}

void print_text(const TapeSummary& tape, const Judgement& judgement, bool colors, std::ostream& out) {
  out << safe(tape.name) << '\n';
  label(out, "layout") << to_string(tape.layout) << '\n';
  label(out, "duration") << seconds_number(tape.duration().count()) << " s\n";
  print_file(tape.read, "read", tape.duration(), out);
  print_file(tape.write, "write", tape.duration(), out);
  label(out, "exchanges") << tape.exchanges << ", " << tape.answered << " answered\n";
  if (tape.latency) {
    label(out, "answers") << "after " << span_text(tape.latency->min_us) << " to "
                          << span_text(tape.latency->max_us) << ", median "
                          << span_text(tape.latency->median_us) << ", p99 " << span_text(tape.latency->p99_us)
                          << '\n';
  }
  print_sessions(tape, out);
  print_events(tape.events, out);
  label(out, "state") << color_begin(color_of(judgement.verdict), colors) << words_of(judgement.verdict)
                      << color_end(colors) << '\n';
  for (const std::string& note : judgement.notes) label(out, "note") << safe(note) << '\n';
  for (const std::string& damage : judgement.damages) label(out, "damage") << safe(damage) << '\n';
}

int info_of(const std::string& argument, bool json, bool colors, std::ostream& out, std::ostream& err) {
  const auto paths = find_tape(argument);
  const auto summary = paths ? summarize(*paths) : Result<TapeSummary>(paths.error());
  if (!summary) {
    out.flush();
    err << "porttape info: " << safe(summary.error().message) << '\n';
    return exit_status_of(summary.error().code);
  }
  const Judgement judgement = judge(*summary);
  json ? print_json(*summary, judgement, out) : print_text(*summary, judgement, colors, out);
  return judgement.damages.empty() ? exit_status::kPass : exit_status::kRuntime;
}

}  // namespace

int run_info(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kInfoHelp);
  line.flag("json", "one JSON object a tape and line (tools/OUTPUT.md)").color();
  if (const auto done = line.parse(args, out, err)) return *done;
  int worst = exit_status::kPass;
  for (const std::string& tape : line.tapes())
    worst = std::max(worst, info_of(tape, line.has("json"), line.colors(out), out, err));
  return worst;
}

}  // namespace porttape
