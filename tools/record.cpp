#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <optional>
#include <ostream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/tape/tape_summary.hpp"
#include "libport/taped/types.hpp"
#include "tools/cassette_verbs.hpp"
#include "tools/command_verb.hpp"
#include "tools/option_description.hpp"
#include "tools/record_mode.hpp"
#include "tools/record_run.hpp"
#include "tools/tap.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr std::string_view kRecordAbout =
    "Runs COMMAND on a port that leads to the device, keeps a tape of what both say,\n"
    "and tells at the end what is on it. The tape is closed whole when COMMAND ends,\n"
    "also by Ctrl-C, which goes to COMMAND (a second one kills it). SIGUSR1 begins\n"
    "the next tape.\n\n"
    "Exit status: COMMAND's own, 128 + N after signal N. Without COMMAND having run:\n"
    "2 wrong use, 6 no such device. Where COMMAND gave 0: 1 something is missing\n"
    "from the tape, 6 the device was lost.\n\n";

// Where a verb says what is not data.
struct Voice {
  std::string_view verb;
  std::ostream& err;
};

void tell(const Voice& voice, std::string_view text) {
  fmt::print(voice.err, "porttape {}: {}\n", voice.verb, printable_line(text));
}

// `device` as a user writes it in a command: `/dev/ttyUSB0`, `192.0.2.7:502`.
std::string main_part(const ChannelPorts& ports) {
  const std::string name = ports.device.get<RecordingOptions>()->inner.name();
  return name.substr(name.find(':') + 1);
}

// The words with {port} in the place of `device`, where they name it.
std::vector<std::string> with_placeholder(std::vector<std::string> words, const std::string& device) {
  for (std::string& word : words) {
    const std::size_t at = device.empty() ? std::string::npos : word.find(device);
    if (at == std::string::npos) continue;
    const std::size_t end = at + device.size();
    if (end == word.size() || std::isalnum(static_cast<unsigned char>(word[end])) == 0)
      word.replace(at, device.size(), "{port}");
  }
  return words;
}

// The same where a word is the device by another name, as a link.
std::vector<std::string> with_port(std::vector<std::string> words, const std::string& device) {
  std::error_code error;
  for (std::string& word : words) {
    if (!device.empty() && std::filesystem::canonical(word, error) == device && !error) word = "{port}";
  }
  return with_placeholder(std::move(words), device);
}

void tell_never_tapped(const std::string& device, bool named, const Voice& voice) {
  tell(voice, fmt::format("the command never opened {}, so that there is no tape",
                          named ? device : "a serial device but its terminal"));
  if (!named) tell(voice, "--device PATH names another tty");
}

void tell_unopened(const std::vector<std::string>& command, const std::string& device, const Voice& voice) {
  tell(voice, "the command never opened its port, so that there is no tape");
  const std::vector<std::string> corrected = with_placeholder(command, device);
  const bool has_port =
      std::ranges::any_of(command, [](const std::string& word) { return word.find("{port}") != word.npos; });
  if (corrected != command) {
    tell(voice, fmt::format("it names the device itself; what is recorded is {{port}}: -- {}",
                            shell_line(corrected)));
  } else if (!has_port) {
    tell(voice, "write {port} in COMMAND for what it is to open, or let it open $PORTTAPE_PORT");
  }
}

std::string recorded_text(const TapeSummary& tape) {
  return fmt::format("{}: {} in {}; {} in {} from the command, {} in {} from the device", tape.name,
                     counted(tape.exchanges, "exchange"), span_text(tape.duration().count()),
                     counted(tape.write.bytes, "byte"), counted(tape.write.blocks, "block"),
                     counted(tape.read.bytes, "byte"), counted(tape.read.blocks, "block"));
}

void tell_gaps(const TapeSummary& tape, const Voice& voice) {
  for (const GapSummary& gap : tape.events.gaps) {
    tell(voice, fmt::format("{}: {} missing at {} s: {}", tape.name,
                            gap.bytes > 0 ? counted(gap.bytes, "byte") + (gap.bytes == 1 ? " is" : " are")
                                          : "something is",
                            seconds_number(to_us(gap.from)), gap.why.for_line()));
  }
}

struct Told {
  bool whole = false;  // nothing is missing on the tape
  bool bytes = false;  // there are any
};

Told tell_tape(const TapePaths& paths, const Voice& voice) {
  const Result<TapeSummary> tape = summarize(paths);
  if (!tape) {
    tell(voice, tape.error().message);
    return {};
  }
  tell(voice, recorded_text(*tape));
  const bool bytes = tape->write.bytes + tape->read.bytes > 0;
  const bool gaps = tape->events.count<event::Gap>() > 0;
  if (!bytes)
    tell(voice,
         gaps ? "no byte is on it" : "no byte is on it: nothing passed between the command and the device");
  tell_gaps(*tape, voice);
  for (const Error& damage : tape->damages()) tell(voice, damage.message);
  return {!gaps && tape->damages().empty(), bytes};
}

// The name of a recording that has these tapes: of a group that of its first connection, the shortest one.
std::string name_of(const std::vector<TapePaths>& tapes, bool group) {
  std::string name = tapes.front().name();
  for (const TapePaths& tape : tapes) {
    if (group && tape.name().size() < name.size()) name = tape.name();
  }
  return name;
}

void tell_next(const std::vector<TapePaths>& tapes, const CommandVerbLine& line,
               const std::vector<std::string>& command, bool supervised, const Voice& voice) {
  const auto connections = line.values.find("connections");
  const bool group = connections != line.values.end() && connections->second == "each";
  const std::string name = shell_line(std::vector{name_of(tapes, group)});
  std::string driver =
      line.own_driver ? "" : "--driver " + shell_line(std::vector{line.values.at("driver")}) + ' ';
  if (group) driver += "--connections each ";
  if (supervised) driver += "--exec ";
  fmt::print(voice.err, "  look at it    porttape cat {}\n  test with it  porttape test --tape {} {}-- {}\n",
             printable_line(name), printable_line(name), printable_line(driver), shell_line(command));
}

int status_of(const RecordRun& record, bool whole) {
  const int status = record.command_ended() ? exit_status::kPass : record.command_end().exit_code();
  if (status != exit_status::kPass) return status;
  if (record.tape_failed()) return exit_status::kRuntime;
  if (record.device_failed()) return exit_status::kDevice;  // and what is missing then is missing for that
  return whole ? exit_status::kPass : exit_status::kRuntime;
}

Result<int> record_on(CommandVerbLine line, const Voice& voice, std::optional<Supervision> supervision) {
  Result<ChannelPorts> ports = channel_ports({ChannelMode::record, line.values});
  if (ports && supervision && supervision->tapped)
    ports = tapped_ports(*ports, supervision->tapped, line.command.front());
  if (!ports) return ports.error();
  const std::string name = fmt::format("porttape {}", voice.verb);
  RecordRun record(name, *ports, line.command, supervision);
  if (Result<void> ran = record.run(); !ran) return ran.error();
  for (const std::string& note : record.notes()) tell(voice, note);
  const CommandEnd& end = record.command_end();
  if (end.exit_code() != 0 && !record.command_ended()) tell(voice, "the command " + end.text());
  const bool unseen = supervision && supervision->tapped && supervision->tapped->was_unseen();
  if (!record.opened() && unseen) {
    tell(voice, "there is no tape: the command had its device where it is not seen, as is told above");
  } else if (!record.opened() && supervision && supervision->tapped) {
    tell_never_tapped(line.values.at("device"), supervision->tapped_device.has_value(), voice);
  } else if (!record.opened()) {
    tell_unopened(line.command, main_part(*ports), voice);
  } else if (record.tapes().empty()) {
    tell(voice, "there is no tape; what went wrong is told above");
  }
  Told all{.whole = true};
  for (const TapePaths& tape : record.tapes()) {
    const Told told = tell_tape(tape, voice);
    all = {all.whole && told.whole, all.bytes || told.bytes};
  }
  std::vector<std::string> next = line.command;
  // A command with a device of its own would talk to that one again.
  if (supervision && supervision->tapped)
    next = with_port(std::move(next), supervision->tapped->device_path());
  if (all.bytes) tell_next(record.tapes(), line, next, supervision.has_value(), voice);
  return status_of(record, all.whole && !unseen);
}

}  // namespace

Result<int> record_command(CommandVerbLine line, std::ostream& err) {
  Result<std::optional<Supervision>> supervision = take_supervision(line.values, true);
  if (!supervision) return supervision.error();
  return record_on(std::move(line), {"record", err}, *supervision);
}

Result<int> record_supervised(CommandVerbLine line, const Supervision& supervision, std::ostream& err) {
  return record_on(std::move(line), {"exec", err}, supervision);
}

int run_record(Arguments args, std::ostream& out, std::ostream& err) {
  std::vector<OptionSpec> options = channel_options(ChannelMode::record);
  OptionSpec mode = record_mode_option();
  mode.default_value = {};
  options.push_back(std::move(mode));
  for (OptionSpec& option : supervision_options(true)) options.push_back(std::move(option));
  const CommandVerb verb{.name = "record",
                         .usage = "--device PORT --tape NAME [options] -- COMMAND…",
                         .about = kRecordAbout,
                         .options = std::move(options),
                         .example = "--device /dev/ttyUSB0 --tape laser -- ./laser_driver {port}"};
  return run_command_verb(verb, args, out, err, [&](CommandVerbLine line) -> Result<int> {
    if (!line.values.contains("record-mode")) return record_command(std::move(line), err);
    const Result<Cassette> cassette = choose_cassette(line.values);
    if (!cassette) return cassette.error();
    if (!cassette->note.empty()) tell({"record", err}, cassette->note);
    line.values =
        cassette->records ? values_to_record(std::move(line.values)) : values_to_play(std::move(line.values));
    return cassette->records ? record_command(std::move(line), err) : play_command(std::move(line), out, err);
  });
}

}  // namespace porttape
