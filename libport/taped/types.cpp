#include "libport/taped/types.hpp"

#include <array>
#include <memory>
#include <string>
#include <utility>

#include "libport/base/whole_number.hpp"
#include "libport/taped/replay_port.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/tap_port.hpp"
#include "libport/taped/tape_keeper.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

Micros milliseconds(double value) { return Micros(static_cast<std::int64_t>(value * 1e3)); }
Micros seconds(double value) { return Micros(static_cast<std::int64_t>(value * 1e6)); }

template <class Enum, std::size_t N>
Enum choice(const std::string& value, const std::pair<std::string_view, Enum> (&choices)[N]) {
  for (const auto& [name, chosen] : choices) {
    if (name == value) return chosen;
  }
  return choices[0].second;
}

Result<ReplayConfig> replay_config(const PortOptions& options) {
  ReplayConfig config;
  config.strictness = static_cast<int>(options.integer("strictness"));
  config.late_allowed = options.flag("early-only");
  config.jitter = milliseconds(options.number("jitter"));
  config.timing = choice<Timing>(
      options.text("timing"),
      {{"reactive", Timing::reactive}, {"recorded", Timing::recorded}, {"none", Timing::none}});
  config.rate = options.number("rate");
  config.on_mismatch = choice<OnMismatch>(options.text("on-mismatch"),
                                          {{"warn", OnMismatch::warn}, {"fail", OnMismatch::fail}});
  config.at_end = choice<AtEnd>(options.text("at-end"),
                                {{"idle", AtEnd::idle}, {"hangup", AtEnd::hangup}, {"exit", AtEnd::exit}});
  config.on_reopen = choice<OnReopen>(
      options.text("on-reopen"),
      {{"auto", OnReopen::automatic}, {"rewind", OnReopen::rewind}, {"continue", OnReopen::continue_}});
  config.chunks =
      choice<Chunks>(options.text("chunks"),
                     {{"auto", Chunks::automatic}, {"recorded", Chunks::recorded}, {"burst", Chunks::burst}});
  config.burst_gap = Micros(options.integer("burst-gap"));
  config.patience = seconds(options.number("patience"));
  if (options.flag("ignoretimes")) {
    config.timing = Timing::none;
    if (config.strictness == 2) config.strictness = 1;
  }
  if (config.strictness == 2 && config.timing == Timing::none) {
    return make_error(Errc::usage,
                      "option 'strictness': 2 checks timing, which timing=none has not; use strictness 1 or "
                      "another timing");
  }
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

Result<ReplayPort::Options> replay_options(const PortOptions& written) {
  const Result<TapePaths> tape = tape_of(written);
  if (!tape) return tape.error();
  const Result<std::uint64_t> session = session_of(written.text("session"));
  if (!session) return session.error();
  const Result<ReplayConfig> config = replay_config(written);
  if (!config) return config.error();
  if (Result<void> apart = check_report_apart(written.text("report"), *tape); !apart) return apart.error();
  return ReplayPort::Options{.tape = *tape,
                             .config = *config,
                             .once = written.flag("once"),
                             .session = *session,
                             .report_file = written.text("report")};
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
    ReplayDefault{ReplayUse::in_process, "on-mismatch", "fail"},
    ReplayDefault{ReplayUse::drop_in, "on-mismatch", "fail"},
    ReplayDefault{ReplayUse::drop_in, "early-only", "1"},
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
       "fail: a write that is not as recorded hangs up the line; warn: it is reported, and the tape goes on",
       0,
       0,
       {"fail", "warn"}},
      {"at-end",
       Kind::choice,
       "idle",
       "idle: behind the end of the tape the device says no more; hangup: it hangs up; exit: the program "
       "ends (the default on udp with once)",
       0,
       0,
       {"idle", "hangup", "exit"}},
      {"on-reopen",
       Kind::choice,
       "auto",
       "rewind: a driver that opens again meets the tape's beginning; continue: what follows; auto: what "
       "follows where a reopen was recorded, else the beginning",
       0,
       0,
       {"auto", "rewind", "continue"}},
      {"chunks",
       Kind::choice,
       "auto",
       "recorded: bytes come in the pieces on the tape; burst: all within burst-gap come at once; auto: "
       "burst for tapes of a program's single reads (flexiport's), else recorded",
       0,
       0,
       {"auto", "recorded", "burst"}},
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
      {.name = "session",
       .default_value = "all",
       .help = "plays this session of the tape alone: 1, 2, …, or all",
       .value_name = "N|all"},
      {"once", Kind::flag, "", "ends after the driver's first run, with its verdict as exit status"},
      {.name = "report", .help = "writes the verdict there as JSON; - is stdout", .value_name = "FILE"},
  });
  type.read = reads(replay_options);
  type.claims = [](const PortSpec& spec) {
    const std::string& report = spec.get<ReplayPort::Options>()->report_file;
    const bool is_file = !report.empty() && report != "-" && !report.starts_with("/dev/");
    return is_file ? std::vector<PortType::Claim>{{"report", report}} : std::vector<PortType::Claim>();
  };
  type.make = makes<ReplayPort::Options>([](const auto& context, const auto&, const auto& options) {
    return std::make_unique<ReplayPort>(context, options);
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

std::string_view replay_default(ReplayUse use, std::string_view option, std::string_view general) {
  for (const ReplayDefault& row : kReplayDefaults) {
    if (row.use == use && row.option == option) return row.value;
  }
  return general;
}

void set_replay_defaults(ReplayUse use, std::map<std::string, std::string>& values) {
  for (const ReplayDefault& row : kReplayDefaults) {
    if (row.use == use) values.try_emplace(std::string(row.option), row.value);
  }
}

}  // namespace porttape
