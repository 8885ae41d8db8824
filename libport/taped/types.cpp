#include "libport/taped/types.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "libport/base/whole_number.hpp"
#include "libport/rules/rule_expectation.hpp"
#include "libport/taped/replayed_device.hpp"
#include "libport/taped/replayed_driver.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/rules_file.hpp"
#include "libport/taped/tap_port.hpp"
#include "libport/taped/tape_keeper.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

Micros from_milliseconds(double value) { return Micros(static_cast<std::int64_t>(value * 1e3)); }
Micros from_seconds(double value) { return Micros(std::llround(value * 1e6)); }

template <class Enum, std::size_t N>
Enum choice(const std::string& value, const std::pair<std::string_view, Enum> (&choices)[N]) {
  for (const auto& [name, chosen] : choices) {
    if (name == value) return chosen;
  }
  return choices[0].second;
}

// `WORD:NUMBER`, as the option has been checked; where there is no number, one by chance.
std::pair<std::string, std::uint32_t> split_number(const std::string& value) {
  const std::size_t colon = value.find(':');
  if (colon == std::string::npos) return {value, std::random_device{}()};
  return {value.substr(0, colon),
          whole_number<std::uint32_t>(std::string_view(value).substr(colon + 1)).value()};
}

// What is asked in any order has no time of its own.
Result<void> check_lookup(const ReplayConfig& config) {
  if (config.match == Match::sequence) return {};
  if (config.timing == Timing::recorded) {
    return make_error(
        Errc::usage,
        "option 'match': lookup answers what is asked, which timing=recorded does not wait for; use "
        "timing=reactive or none");
  }
  if (config.strictness == 2) {
    return make_error(
        Errc::usage,
        "option 'strictness': 2 checks when each write comes, and with match=lookup it may come at any "
        "time; use strictness 1");
  }
  if (config.check_settings) {
    return make_error(
        Errc::usage,
        "option 'check-settings': settings are made in the tape's order, which match=lookup does not "
        "keep; leave one of them out");
  }
  return {};
}

Result<ReplayConfig> replay_config(const PortOptions& options) {
  ReplayConfig config;
  config.strictness = static_cast<int>(options.integer("strictness"));
  config.late_allowed = options.flag("early-only");
  config.jitter = from_milliseconds(options.number("jitter"));
  config.timing = choice<Timing>(
      options.text("timing"),
      {{"reactive", Timing::reactive}, {"recorded", Timing::recorded}, {"none", Timing::none}});
  config.rate = options.number("rate");
  config.on_mismatch = choice<OnMismatch>(
      options.text("on-mismatch"),
      {{"warn", OnMismatch::warn}, {"fail", OnMismatch::fail}, {"resync", OnMismatch::resync}});
  config.match =
      choice<Match>(options.text("match"), {{"sequence", Match::sequence}, {"lookup", Match::lookup}});
  config.at_end = choice<AtEnd>(
      options.text("at-end"),
      {{"idle", AtEnd::idle}, {"hangup", AtEnd::hangup}, {"exit", AtEnd::exit}, {"loop", AtEnd::idle}});
  const bool loops = options.text("at-end") == "loop" || options.has("loops");
  config.loops = loops ? static_cast<std::uint64_t>(options.integer("loops")) : 1;
  config.start = TapeTime{from_seconds(options.number("start"))};
  if (options.has("end")) config.end = TapeTime{from_seconds(options.number("end"))};
  config.preroll = options.flag("preroll");
  if (options.has("max-gap")) config.max_gap = from_seconds(options.number("max-gap"));
  if (config.end && *config.end <= config.start) {
    return make_error(Errc::usage, "option 'end' is '" + options.text("end") +
                                       "', which is not behind the start (" + options.text("start") +
                                       " s); accepted: a later time of the tape, in seconds");
  }
  const bool in_order = config.match == Match::sequence && config.on_mismatch != OnMismatch::resync;
  if (!in_order && (config.start > TapeTime{} || config.loops != 1)) {
    return make_error(Errc::usage,
                      std::string("option '") + (config.loops != 1 ? "loops" : "start") +
                          "': a tape whose requests are looked up has no order; leave it out, or "
                          "match=lookup and on-mismatch=resync");
  }
  if (config.preroll && config.start == TapeTime{}) {
    return make_error(Errc::usage, "option 'preroll' plays what precedes the option 'start', which is 0");
  }
  config.on_reopen = choice<OnReopen>(
      options.text("on-reopen"),
      {{"auto", OnReopen::automatic}, {"rewind", OnReopen::rewind}, {"continue", OnReopen::continue_}});
  const auto [chunks, seed] = split_number(options.text("chunks"));
  config.chunks = choice<Chunks>(chunks, {{"auto", Chunks::automatic},
                                          {"recorded", Chunks::recorded},
                                          {"burst", Chunks::burst},
                                          {"bytes", Chunks::bytes},
                                          {"random", Chunks::random}});
  config.chunk_seed = seed;
  config.burst_gap = Micros(options.integer("burst-gap"));
  config.check_settings = options.flag("check-settings");
  config.must_read = options.flag("must-read");
  config.patience = from_seconds(options.number("patience"));
  if (options.flag("ignoretimes")) {
    config.timing = Timing::none;
    if (config.strictness == 2) config.strictness = 1;
  }
  if (config.strictness == 2 && config.timing == Timing::none) {
    return make_error(Errc::usage,
                      "option 'strictness': 2 checks timing, which timing=none has not; use strictness 1 or "
                      "another timing");
  }
  if (const Result<void> possible = check_lookup(config); !possible) return possible.error();
  return config;
}

// The option `file`.
Result<TapePaths> tape_of(const PortOptions& written) {
  const std::string file = written.text("file");
  if (file.empty()) return make_error(Errc::usage, "option 'file' is empty; accepted: the name of a tape");
  return literal_tape(file);
}

// The number of a session; 0: all.
Result<std::uint64_t> session_of(const std::string& written) {
  if (written == "all") return std::uint64_t{0};
  if (const auto session = whole_number<std::uint64_t>(written); session && *session > 0) return *session;
  return make_error(Errc::usage, "option 'session' is '" + written +
                                     "'; accepted: all, or the number of one session of the tape, from 1 on");
}

// Of a rules file; null without one.
Result<std::shared_ptr<const Expectation>> expectation_of(const std::string& rules_file) {
  if (rules_file.empty()) return std::shared_ptr<const Expectation>();
  Result<RuleSet> rules = read_rules_file(rules_file);
  if (!rules) return rules.error();
  return std::shared_ptr<const Expectation>(std::make_shared<const RuleExpectation>(std::move(*rules)));
}

Result<ReplayOptions> replay_options(const PortOptions& written) {
  const Result<TapePaths> tape = tape_of(written);
  if (!tape) return tape.error();
  const Result<std::uint64_t> session = session_of(written.text("session"));
  if (!session) return session.error();
  const Result<ReplayConfig> config = replay_config(written);
  if (!config) return config.error();
  for (const char* option : {"report", "junit"}) {
    if (Result<void> apart = check_report_apart(written.text(option), *tape); !apart) return apart.error();
  }
  if (Result<void> apart = check_reports_apart(written.text("report"), written.text("junit")); !apart)
    return apart.error();
  const Result<std::shared_ptr<const Expectation>> rules = expectation_of(written.text("rules"));
  if (!rules) return rules.error();
  return ReplayOptions{.tape = *tape,
                       .config = *config,
                       .once = written.flag("once"),
                       .start_paused = written.flag("start-paused"),
                       .session = *session,
                       .report_file = written.text("report"),
                       .junit_file = written.text("junit"),
                       .expectation = *rules};
}

OnExisting on_existing(const PortOptions& written) {
  const std::string chosen = written.text("on-existing");
  if (written.flag("overwrite") || chosen == "overwrite") return OnExisting::overwrite;
  return chosen == "next" ? OnExisting::next : OnExisting::refuse;
}

Result<RecordingOptions> recording_options(const PortType& inner_type, const PortOptions& written) {
  const Result<TapePaths> tape = tape_of(written);
  if (!tape) return tape.error();
  PortOptions inner{&inner_type, written.values};
  for (const OptionSpec& own : tape_options()) inner.values.erase(std::string(own.name));
  Result<PortSpec> read = PortSpec::read(std::move(inner));
  if (!read) return read.error();
  return RecordingOptions{std::move(*read), *tape, on_existing(written), written.flag("failclosed")};
}

Result<std::unique_ptr<Port>> make_recording_port(const PortContext& context, const RecordingOptions& options,
                                                  const std::string& peer) {
  const PortType& type = options.inner.type();
  Result<std::unique_ptr<Port>> port = type.make(context, options.inner, peer);
  if (!port) return port;
  TapeKeeper::Options tape{
      .tape = options.tape,
      .header = {.device = options.inner.spelled(),
                 .driver = peer,
                 .transport = (*port)->keeps_datagrams() ? Transport::datagram : Transport::stream,
                 .stamped = context.pulled ? Stamped::read : Stamped::arrival},
      .on_existing = options.on_existing,
      .fail_closed = options.fail_closed,
      .group = options.group,
      .connection = options.connection,
      .describe =
          [device = port->get(), name = options.device_name](TapeHeader& header) {
            header.identity = device->identity();
            if (header.identity && !check_identity(*header.identity)) header.identity.reset();
            if (name) header.device = name();
          },
      .on_ended = options.on_ended};
  auto tap = std::make_unique<TapPort>(context, std::move(*port));
  tap->add(std::make_unique<TapeKeeper>(context, std::move(tape), [&tap = *tap] { tap.must_end(); }));
  return std::unique_ptr<Port>(std::move(tap));
}

const OptionSpec kFile{.name = "file",
                       .default_value = "port.log",
                       .help = "the tape: files NAMEr, NAMEw and NAMEe",
                       .value_name = "NAME"};

struct ReplayDefault {
  ReplayUse use;
  std::string_view option;
  std::string_view value;
};

constexpr std::array kReplayDefaults = {
    ReplayDefault{ReplayUse::verb, "strictness", "1"},
    ReplayDefault{ReplayUse::verb, "timing", "reactive"},
    ReplayDefault{ReplayUse::test, "strictness", "1"},
    ReplayDefault{ReplayUse::test, "timing", "reactive"},
    ReplayDefault{ReplayUse::test, "on-mismatch", "fail"},
    ReplayDefault{ReplayUse::drive, "strictness", "1"},
    ReplayDefault{ReplayUse::drive, "timing", "reactive"},
    ReplayDefault{ReplayUse::drive, "on-mismatch", "fail"},
    ReplayDefault{ReplayUse::in_process, "on-mismatch", "fail"},
    ReplayDefault{ReplayUse::drop_in, "on-mismatch", "fail"},
    ReplayDefault{ReplayUse::drop_in, "early-only", "1"},
};

struct ReplayHelp {
  ReplayUse use;
  std::string_view option;
  std::string_view help;
};

// Where the tape plays the driver.
constexpr std::array kReplayHelps = {
    ReplayHelp{ReplayUse::drive, "strictness",
               "0: what the device sends is not checked; 1: its bytes must be those recorded; 2: their times "
               "too"},
    ReplayHelp{ReplayUse::drive, "jitter",
               "with strictness 2, how much earlier or later than recorded an answer may come"},
    ReplayHelp{ReplayUse::drive, "early-only",
               "with strictness 2, an answer may come as late as it likes, and only not too early"},
    ReplayHelp{
        ReplayUse::drive, "timing",
        "reactive: a write is sent when the device has sent what is before it on the tape, with the "
        "recorded delay; recorded: at the recorded times, whatever the device does; none: as reactive, "
        "without delay"},
    ReplayHelp{
        ReplayUse::drive, "on-mismatch",
        "fail: an answer that is not as recorded ends the run; warn: it is reported, and the tape goes "
        "on"},
    ReplayHelp{ReplayUse::drive, "patience",
               "at strictness 0, how long a recorded answer is waited for before the tape goes on anyway"},
};

}  // namespace

PortType logreader_type() {
  PortType type{"logreader", {"file"}, "a tape in the device's place"};
  type.options = with_common({
      kFile,
      {"strictness", Kind::integer, "0",
       "0: writes are not checked; 1: their bytes must be those recorded; 2: their times too", 0, 2},
      {.name = "jitter",
       .kind = Kind::number,
       .default_value = "100",
       .help = "with strictness 2, how much earlier or later than recorded a write may come",
       .max = 1e9,
       .unit = "ms"},
      {"early-only", Kind::flag, "",
       "with strictness 2, a write may come as late as it likes, and only not too early"},
      {"ignoretimes", Kind::flag, "", "the same as timing=none"},
      {"timing",
       Kind::choice,
       "recorded",
       "reactive: the device speaks after the writes that it answers, with the recorded delay; recorded: at "
       "the recorded times, whatever the driver does; none: as reactive, without delay",
       0,
       0,
       {"reactive", "recorded", "none"}},
      {.name = "rate",
       .kind = Kind::number,
       .default_value = "1",
       .help = "time runs so many times as fast",
       .min = 1e-6,
       .max = 1e6,
       .value_name = "X"},
      {"on-mismatch",
       Kind::choice,
       "warn",
       "fail: a write that is not as recorded hangs up the line; warn: it is reported, and the tape goes on; "
       "resync: it is reported, and the tape goes on where it has what the driver wrote",
       0,
       0,
       {"fail", "warn", "resync"}},
      {"match",
       Kind::choice,
       "sequence",
       "sequence: the driver writes what is on the tape in the tape's order; lookup: any request on the tape "
       "is "
       "answered whenever it comes, in recorded order where it has several answers, then the last again",
       0,
       0,
       {"sequence", "lookup"}},
      {"at-end",
       Kind::choice,
       "idle",
       "idle: behind the end of the tape the device says no more; hangup: it hangs up; exit: the program "
       "ends (the default on udp with once); loop: the tape begins again, for ever or as often as loops says",
       0,
       0,
       {"idle", "hangup", "exit", "loop"}},
      {.name = "loops",
       .kind = Kind::integer,
       .default_value = "0",
       .help = "the tape is played so often in all, 0: for ever; with at-end=loop, or without: then at-end "
               "follows the last. All are one run",
       .max = 1e9},
      {.name = "start",
       .kind = Kind::number,
       .default_value = "0",
       .help = "plays the tape from there; what the driver wrote before is not expected",
       .max = 1e9,
       .value_name = "SEC",
       .unit = "s"},
      {.name = "end",
       .kind = Kind::number,
       .help = "plays it up to there; else to its end",
       .max = 1e9,
       .value_name = "SEC",
       .unit = "s"},
      {"preroll", Kind::flag, "",
       "plays the handshake before start first, without waiting: what is between the open and the driver's "
       "first pause of a second"},
      {.name = "max-gap",
       .kind = Kind::number,
       .help = "idle gaps of the tape that are longer are cut to it",
       .max = 1e9,
       .value_name = "SEC",
       .unit = "s"},
      {"start-paused", Kind::flag, "", "the clock stands until `porttape ctl resume`, or step"},
      {"on-reopen",
       Kind::choice,
       "auto",
       "rewind: a driver that opens again meets the tape's beginning; continue: what follows (behind the "
       "tape's end all that it writes is extra); auto: what follows where a reopen was recorded, else the "
       "beginning",
       0,
       0,
       {"auto", "rewind", "continue"}},
      {"chunks",
       Kind::choice,
       "auto",
       "recorded: bytes come in the pieces on the tape; burst: all within burst-gap come at once; auto: "
       "burst for tapes of a program's single reads (flexiport's), else recorded; bytes: one by one, and "
       "random: "
       "in pieces by chance (the report has the seed, which gives the same cuts again), each as soon as the "
       "driver has read the one before, at most 100 ms late",
       0,
       0,
       {"auto", "recorded", "burst", "bytes", "random[:SEED]"}},
      {.name = "burst-gap",
       .kind = Kind::integer,
       .default_value = "500",
       .help = "with chunks=burst, bytes less than so many microseconds apart come at once",
       .max = 1e9,
       .unit = "us"},
      {.name = "patience",
       .kind = Kind::number,
       .default_value = "1",
       .help = "at strictness 0, how long the device waits for a recorded write before it speaks anyway",
       .max = 1e9,
       .unit = "s"},
      {"check-settings", Kind::flag, "",
       "recorded line settings that the driver never makes are a mismatch, not a note"},
      {"must-read", Kind::flag, "",
       "what was recorded as read and the driver did not read makes its run incomplete, not doubtful (at "
       "strictness 0 it stays a doubt)"},
      {.name = "rules",
       .help = "what of a write may vary, and how the answer follows: a rules file (RULES.md)",
       .value_name = "FILE"},
      {.name = "session",
       .default_value = "all",
       .help = "plays this session of the tape alone: 1, 2, …, or all",
       .value_name = "N|all"},
      {"once", Kind::flag, "", "ends after the driver's first run, with its verdict as exit status"},
      {.name = "report", .help = "writes the verdict there as JSON; - is stdout", .value_name = "FILE"},
      {.name = "junit",
       .help = "writes the verdict there as a JUnit file; - is stdout",
       .value_name = "FILE"},
  });
  type.read = reads(replay_options);
  type.claims = [](const PortSpec& spec) {
    const ReplayOptions& options = *spec.get<ReplayOptions>();
    std::vector<PortType::Claim> claims;
    for (const std::string& file : {options.report_file, options.junit_file}) {
      if (!file.empty() && file != "-" && !file.starts_with("/dev/")) claims.emplace_back("report", file);
    }
    return claims;
  };
  type.make = makes<ReplayOptions>(
      [](const auto& context, const auto&, const auto& options) -> std::unique_ptr<Port> {
        if (options.config.writer == Writer::device)
          return std::make_unique<ReplayedDriver>(context, options);
        return std::make_unique<ReplayedDevice>(context, options);
      });
  return type;
}

std::vector<OptionSpec> tape_options() {
  return {
      kFile,
      {"on-existing",
       Kind::choice,
       "refuse",
       "refuse: a tape of that name is an error; next: the next free name is taken (laser.2.log); "
       "overwrite: it is replaced",
       0,
       0,
       {"refuse", "next", "overwrite"}},
      {"overwrite", Kind::flag, "", "the same as on-existing=overwrite"},
      {"failclosed", Kind::flag, "",
       "ends when the tape cannot be written; else the line goes on without it"},
  };
}

PortType recording_type(const PortType& inner) {
  PortType type{inner.recorded_as, inner.form, "a port with a tape of it"};
  type.listening = inner.listening;
  type.records = inner.name;
  type.keeps_datagrams = inner.keeps_datagrams;
  type.options = tape_options();
  type.options.insert(type.options.end(), inner.options.begin(), inner.options.end());
  type.complete = inner.complete;
  type.read = reads([inner = std::make_shared<const PortType>(inner)](const PortOptions& written) {
    return recording_options(*inner, written);
  });
  type.make = [](const PortContext& context, const PortSpec& spec, const std::string& peer) {
    return make_recording_port(context, *spec.get<RecordingOptions>(), peer);
  };
  type.claims = [](const PortSpec& spec) {
    const RecordingOptions& options = *spec.get<RecordingOptions>();
    std::vector<PortType::Claim> claims = options.inner.type().claims(options.inner);
    claims.emplace_back("tape", options.tape.name());
    return claims;
  };
  return type;
}

Result<PortSpec> recorded_replay(const PortSpec& replay, const TapePaths& tape) {
  static const PortType plain = logreader_type();
  static const PortType type = [] {
    PortType made = recording_type(plain);
    made.name = "recorded replay";
    made.read = reads([](const PortOptions& written) -> Result<RecordingOptions> {
      Result<PortSpec> inner = PortSpec::read(PortOptions{&plain, written.values});
      if (!inner) return inner.error();
      return RecordingOptions{.inner = std::move(*inner), .tape = {}};
    });
    return made;
  }();
  Result<PortSpec> spec = PortSpec::read(PortOptions{&type, replay.written().values});
  if (spec) spec->set(RecordingOptions{.inner = replay, .tape = tape});
  return spec;
}

std::string_view replay_default(ReplayUse use, std::string_view option, std::string_view general) {
  for (const ReplayDefault& row : kReplayDefaults) {
    if (row.use == use && row.option == option) return row.value;
  }
  return general;
}

std::string_view replay_help(ReplayUse use, std::string_view option, std::string_view general) {
  for (const ReplayHelp& row : kReplayHelps) {
    if (row.use == use && row.option == option) return row.help;
  }
  return general;
}

bool is_of_device(std::string_view option, std::string_view choice) {
  constexpr std::array<std::string_view, 7> of_device = {"at-end",    "check-settings", "loops", "match",
                                                         "must-read", "on-reopen",      "once"};
  // It looks for the request that the driver went on with.
  if (option == "on-mismatch" && choice == "resync") return true;
  return std::ranges::find(of_device, option) != of_device.end();
}

void set_replay_defaults(ReplayUse use, std::map<std::string, std::string>& values) {
  for (const ReplayDefault& row : kReplayDefaults) {
    if (row.use == use) values.try_emplace(std::string(row.option), row.value);
  }
}

}  // namespace porttape
