#include <algorithm>
#include <chrono>
#include <ctime>
#include <fmt/format.h>
#include <map>
#include <optional>
#include <set>
#include <unistd.h>
#include <vector>

#include <boost/json/array.hpp>
#include <boost/json/serialize.hpp>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "tools/command_line.hpp"
#include "tools/control_client.hpp"
#include "tools/openers.hpp"
#include "tools/output.hpp"
#include "tools/verb_clock.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

using Openers = std::map<std::string, std::vector<Opener>>;

constexpr VerbHelp kStatusHelp{
    "status", "[-p PID] [--user NAME|all] [--json]",
    "Says what the daemons do that run: since when, on which ports, who has them open, bytes,\n"
    "tapes, the last trouble. One's own daemons are seen and those of the system's units, by\n"
    "root with --user those of others too. Of each that does not answer within 2 s it says that\n"
    "it is silent. Exit status: 0, 1 no daemon runs (or none that answers).\n",
    "  porttape status\n"
    "  porttape status --json | jq -r '.channels[].tapes[].name'\n"};

constexpr std::size_t kStatusWidth = 80;
constexpr std::size_t kIndent = 13;

std::optional<std::time_t> time_of(const std::string& utc) {
  std::tm parts{};
  if (::strptime(utc.c_str(), "%Y-%m-%dT%H:%M:%SZ", &parts) == nullptr) return std::nullopt;
  return ::timegm(&parts);
}

std::string local_text(std::time_t time) {
  std::tm parts{};
  ::localtime_r(&time, &parts);
  char text[32];
  return {text, std::strftime(text, sizeof text, "%F %T", &parts)};
}

// "2026-11-22 10:54:57 (12 min ago)", in the time of this place.
std::string moment_text(const std::string& utc) {
  const auto time = time_of(utc);
  if (!time) return utc;
  const std::int64_t s =
      std::max<std::int64_t>(std::chrono::system_clock::to_time_t(verb_clock().wall()) - *time, 0);
  const std::string ago = s < 120      ? fmt::format("{} s", s)
                          : s < 7200   ? fmt::format("{} min", s / 60)
                          : s < 172800 ? fmt::format("{} h", s / 3600)
                                       : fmt::format("{} days", s / 86400);
  return fmt::format("{} ({} ago)", local_text(*time), ago);
}

// A label and a text, in lines of kStatusWidth as far as its words allow that.
void print_field(std::ostream& out, std::string_view label, std::string_view text) {
  std::string line = fmt::format("    {:<{}}", label, kIndent - 4);
  const std::string shown = printable_line(text);
  std::string_view left = shown;
  bool first = true;
  while (!left.empty()) {
    const std::string_view word = left.substr(0, left.find(' '));
    left.remove_prefix(std::min(word.size() + 1, left.size()));
    if (!first && line.size() + 1 + word.size() > kStatusWidth) {
      out << line << '\n';
      line.assign(kIndent, ' ');
      first = true;
    }
    if (!first) line += ' ';
    line += word;
    first = false;
  }
  out << line << '\n';
}

std::string state_text(const json::object& channel, std::string_view state) {
  const std::pair<std::string_view, std::string_view> words[] = {
      {"waiting", "waits for a driver"},
      {"opening", "opens the device for its driver"},
      {"open", "open"},
      {"interrupted", "the device is gone; it is opened again when it is back"},
      {"broken", "the device is gone; the driver has yet to close"},
      {"draining", "sends a driver's last bytes to the device"},
      {"ending", "ends"},
  };
  if (state == "ended") return fmt::format("has ended with status {}", number_of(channel, "exit_status"));
  if (state == "retrying") {
    return fmt::format("in trouble, tried again in {} s: {}", number_of(channel, "retry_in_s"),
                       text_of(channel, "why"));
  }
  for (const auto& [word, text] : words) {
    if (word == state) return std::string(text);
  }
  return std::string(state);
}

std::string opener_text(const std::string& state, const std::vector<Opener>& openers) {
  std::string text;
  for (const Opener& opener : openers)
    text += fmt::format("{}{} ({})", text.empty() ? ", opened by " : ", ", opener.name, opener.pid);
  // /proc shows the files of one's own processes alone.
  if (text.empty() && (state == "open" || state == "opening")) return ", opened by a process of another user";
  return text;
}

std::string tape_text(const json::object& tape) {
  const std::string state = text_of(tape, "state");
  const std::string name = text_of(tape, "name");
  if (state == "waiting") return name + ": begins when a driver comes";
  std::string text =
      fmt::format("{}: {}{}{} bytes", name, state == "recording" ? "" : "NOT RECORDING: ",
                  state == "recording" ? "" : text_of(tape, "why") + "; ", number_of(tape, "bytes"));
  if (const auto waiting = number_of(tape, "queued_bytes"); waiting > 0)
    text += fmt::format(", {} wait for the disk", waiting);
  if (const auto lost = number_of(tape, "lost_bytes"); lost > 0) text += fmt::format(", {} LOST", lost);
  return text;
}

// "paused at 3.2 of 12.3 s, 2 times as fast, loop 3 of 10".
std::string playback_text(const json::object& playback) {
  const auto seconds = [&](std::string_view key) {
    const json::value* const value = playback.if_contains(key);
    return value != nullptr && value->is_number() ? std::optional(value->to_number<double>()) : std::nullopt;
  };
  const auto* const paused = playback.if_contains("paused");
  const bool stands = paused != nullptr && paused->is_bool() && paused->as_bool();
  const auto position = seconds("position_s");
  std::string text = stands ? "paused" : position ? "plays" : "begins with the driver's open";
  if (position) text += fmt::format(" at {:.3f} s", *position);
  if (const auto length = seconds("length_s"); length && position)
    text += fmt::format(" of {:.3f} s", *length);
  if (const double rate = seconds("rate").value_or(1); rate != 1) text += fmt::format(", rate {}", rate);
  const auto loops = seconds("loops");
  if (const double loop = seconds("loop").value_or(0); loop > 0 && loops != 1)
    text += fmt::format(", loop {}{}", loop, loops ? fmt::format(" of {}", *loops) : "");
  return text;
}

void print_lines(const json::object& channel, const Openers& openers, std::ostream& out) {
  const std::vector<json::object> lines = objects_of(channel, "lines");
  if (lines.empty()) {
    print_field(out, "driver", text_of(channel, "driver"));
    print_field(out, "device", text_of(channel, "device"));
  }
  for (const json::object& line : lines) {
    const std::string node = text_of(line, "driver_node");
    const std::string driver = text_of(line, "driver");
    const auto found = openers.find(node);
    std::string text = driver;
    if (!node.empty()) {
      if (!driver.ends_with(node)) text += " (" + node + ")";
      text +=
          opener_text(text_of(line, "state"), found == openers.end() ? std::vector<Opener>() : found->second);
    }
    if (lines.size() > 1) text += ": " + state_text(channel, text_of(line, "state"));
    print_field(out, "driver", text);
    print_field(out, "device", text_of(line, "device"));
    if (line.contains("playback")) print_field(out, "playback", playback_text(object_of(line, "playback")));
  }
}

void print_channel(const json::object& channel, const Openers& openers, std::ostream& out) {
  print_field(out, "state", state_text(channel, text_of(channel, "state")));
  print_lines(channel, openers, out);
  const auto opens = number_of(channel, "opens");
  std::string bytes =
      fmt::format("{} from the driver, {} from the device, in {} {}", number_of(channel, "from_driver_bytes"),
                  number_of(channel, "to_driver_bytes"), opens, opens == 1 ? "open" : "opens");
  if (const auto dropped = number_of(channel, "dropped_bytes"); dropped > 0)
    bytes += fmt::format("; {} reached nobody", dropped);
  print_field(out, "bytes", bytes);
  for (const json::object& tape : objects_of(channel, "tapes")) print_field(out, "tape", tape_text(tape));
  const json::value* trouble = channel.if_contains("last_trouble");
  if (trouble != nullptr && trouble->is_object()) {
    const json::object& told = trouble->get_object();
    print_field(out, "trouble", moment_text(text_of(told, "at")) + ": " + text_of(told, "text"));
  }
}

void print_text(const json::object& status, const Openers& openers, std::ostream& out) {
  out << printable_line(fmt::format("porttaped {}, pid {}, since {}", text_of(status, "verb"),
                                    number_of(status, "pid"), moment_text(text_of(status, "since"))))
      << '\n';
  for (const json::object& channel : objects_of(status, "channels")) {
    out << "  " << printable_line(text_of(channel, "name")) << " ("
        << printable_line(text_of(channel, "mode")) << ")\n";
    print_channel(channel, openers, out);
  }
}

// With who has the ports open, which a daemon does not look for.
void add_openers(json::object& status, const Openers& openers) {
  json::value* channels = status.if_contains("channels");
  if (channels == nullptr || !channels->is_array()) return;
  for (json::value& channel : channels->get_array()) {
    json::value* lines = channel.is_object() ? channel.get_object().if_contains("lines") : nullptr;
    if (lines == nullptr || !lines->is_array()) continue;
    for (json::value& line : lines->get_array()) {
      if (!line.is_object()) continue;
      json::array list;
      const auto found = openers.find(text_of(line.get_object(), "driver_node"));
      if (found != openers.end()) {
        for (const Opener& opener : found->second)
          list.push_back(json::object{{"pid", opener.pid}, {"name", to_utf8(opener.name)}});
      }
      line.get_object()["openers"] = std::move(list);
    }
  }
}

Openers openers_of(const RunningDaemons& running) {
  std::set<std::string> nodes;
  for (const RunningDaemon& daemon : running.daemons) {
    for (const json::object& channel : objects_of(daemon.status, "channels")) {
      for (const json::object& line : objects_of(channel, "lines")) {
        if (const std::string node = text_of(line, "driver_node"); !node.empty()) nodes.insert(node);
      }
    }
  }
  return porttape::openers_of(nodes);
}

}  // namespace

int run_status(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kStatusHelp);
  line.takes_nothing().flag("json", "one JSON object a daemon and line (tools/OUTPUT.md)").color();
  WantedDaemons::add_options(line);
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<WantedDaemons> wanted = WantedDaemons::of(line);
  if (!wanted) return line.usage_error(err, wanted.error().message);
  RunningDaemons running = find_daemons(*wanted);
  const Openers openers = openers_of(running);
  for (RunningDaemon& daemon : running.daemons) {
    if (line.has("json")) {
      add_openers(daemon.status, openers);
      out << json_for_terminal(json::serialize(daemon.status)) << '\n';
    } else {
      print_text(daemon.status, openers, out);
    }
  }
  out.flush();
  for (const Error& silent : running.silent) {
    err << "porttape status: " << (silent.code == Errc::usage ? "" : "silent: ")
        << printable_line(silent.message) << '\n';
  }
  if (!running.daemons.empty()) return exit_status::kPass;
  if (running.silent.empty()) err << "porttape status: " << no_daemon_text(*wanted) << '\n';
  return exit_status::kRuntime;
}

}  // namespace porttape
