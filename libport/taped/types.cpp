#include "libport/taped/types.hpp"

#include <array>
#include <charconv>
#include <memory>
#include <string>
#include <utility>

#include "libport/taped/replay_port.hpp"
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
  std::uint64_t session = 0;
  if (written == "all") return session;
  const char* const end = written.data() + written.size();
  const auto [stop, error] = std::from_chars(written.data(), end, session);
  if (error == std::errc() && stop == end && session > 0) return session;
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
      .connection = options.connection};
  auto tap = std::make_unique<TapPort>(context, std::move(*port));
  tap->add(std::make_unique<TapeKeeper>(context, std::move(tape), [&tap = *tap] { tap.must_end(); }));
  return std::unique_ptr<Port>(std::move(tap));
}

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
      {"file", Kind::text, "port.log", "the tape: FILEr, FILEw, FILEe"},
      {"strictness", Kind::integer, "0", "0 writes not checked, 1 data, 2 data and timing", 0, 2},
      {"jitter", Kind::number, "100", "ms, margin of strictness 2, early and late", 0, 1e9},
      {"early-only", Kind::flag, "", "strictness 2 accepts late writes, as flexiport's documentation does"},
      {"ignoretimes", Kind::flag, "", "the same as timing=none"},
      {"timing",
       Kind::choice,
       "recorded",
       "when bytes become readable",
       0,
       0,
       {"reactive", "recorded", "none"}},
      {"rate", Kind::number, "1", "time runs this many times as fast", 1e-6, 1e6},
      {"on-mismatch", Kind::choice, "warn", "what a wrong write does", 0, 0, {"fail", "warn"}},
      {"at-end",
       Kind::choice,
       "idle",
       "what the used-up tape does (exit by --once on udp)",
       0,
       0,
       {"idle", "hangup", "exit"}},
      {"on-reopen", Kind::choice, "auto", "what a second open does", 0, 0, {"auto", "rewind", "continue"}},
      {"chunks",
       Kind::choice,
       "auto",
       "how bytes are cut into arrivals",
       0,
       0,
       {"auto", "recorded", "burst"}},
      {"burst-gap", Kind::integer, "500", "µs, reads closer than this are one burst", 0, 1e9},
      {"patience", Kind::number, "1", "s, strictness 0 waits this long for a write", 0, 1e9},
      {"session", Kind::text, "all", "play this session of the tape alone (1, 2, …), or all"},
      {"once", Kind::flag, "", "the program ends after the first run, with its verdict"},
      {"report", Kind::text, "", "file for the verdict as JSON"},
  });
  type.read = reads(replay_options);
  type.make = makes<ReplayPort::Options>([](const auto& context, const auto&, const auto& options) {
    return std::make_unique<ReplayPort>(context, options);
  });
  return type;
}

std::vector<OptionSpec> tape_options() {
  return {
      {"file", Kind::text, "port.log", "the tape: FILEr, FILEw, FILEe"},
      {"on-existing",
       Kind::choice,
       "refuse",
       "a tape of that name is there: an error, the next free name (laser.2.log), or it is replaced",
       0,
       0,
       {"refuse", "next", "overwrite"}},
      {"overwrite", Kind::flag, "", "the same as on-existing=overwrite"},
      {"failclosed", Kind::flag, "", "ends when the tape cannot be written; else the line stays up"},
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
