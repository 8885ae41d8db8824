// What the options of a replay and of a recording mean, and which of them contradict each other.

#include "libport/taped/types.hpp"

#include <fmt/format.h>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/replay_config.hpp"
#include "libport/taped/replay_options.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const PortTypes& replay_types() {
  static const PortTypes types({logreader_type()});
  return types;
}

Result<ReplayOptions> read_options(const std::string& more) {
  const Result<PortOptions> written = parse_options(replay_types(), "logreader:t.log" + more);
  if (!written) return written.error();
  const Result<PortSpec> spec = PortSpec::read(*written);
  if (!spec) return spec.error();
  return *spec->get<ReplayOptions>();
}
ReplayOptions options_of(const std::string& more) {
  const Result<ReplayOptions> options = read_options(more);
  EXPECT_TRUE(options) << more << ": " << options.error().message;
  return options ? *options : ReplayOptions{};
}
std::string refusal_of(const std::string& more) {
  const Result<ReplayOptions> options = read_options(more);
  EXPECT_FALSE(options) << more;
  if (options) return {};
  EXPECT_EQ(options.error().code, Errc::usage);
  return options.error().message;
}

// Those that nothing is given for.
ReplayConfig usual() {
  ReplayConfig config;
  config.strictness = 0;
  config.timing = Timing::recorded;
  config.chunk_seed = options_of("").config.chunk_seed;
  return config;
}

TEST(ReplayOptions, WithoutAnyItIsAsFlexiports) {
  const ReplayOptions options = options_of("");
  ReplayConfig config = options.config;
  const ReplayConfig due = usual();
  config.chunk_seed = due.chunk_seed;
  EXPECT_TRUE(config == due);
  EXPECT_EQ(options.tape.name(), "t.log");
  EXPECT_FALSE(options.once || options.start_paused);
  EXPECT_EQ(options.session, 0U);
  EXPECT_EQ(options.report_file + options.junit_file, "");
  EXPECT_EQ(options.expectation, nullptr);
}

TEST(ReplayOptions, EachIsWhatItSays) {
  using Change = std::function<void(ReplayConfig&)>;
  const std::vector<std::pair<std::string, Change>> known = {
      {"strictness=1", [](auto& c) { c.strictness = 1; }},
      {"strictness=2", [](auto& c) { c.strictness = 2; }},
      {"jitter=2.5", [](auto& c) { c.jitter = Micros(2500); }},
      {"early-only", [](auto& c) { c.late_allowed = true; }},
      {"timing=reactive", [](auto& c) { c.timing = Timing::reactive; }},
      {"timing=recorded", [](auto&) {}},
      {"timing=none", [](auto& c) { c.timing = Timing::none; }},
      {"ignoretimes", [](auto& c) { c.timing = Timing::none; }},
      {"strictness=2,ignoretimes", [](auto& c) { c.timing = Timing::none, c.strictness = 1; }},
      {"strictness=0,ignoretimes", [](auto& c) { c.timing = Timing::none; }},
      {"rate=2.5", [](auto& c) { c.rate = 2.5; }},
      {"on-mismatch=warn", [](auto&) {}},
      {"on-mismatch=fail", [](auto& c) { c.on_mismatch = OnMismatch::fail; }},
      {"on-mismatch=resync", [](auto& c) { c.on_mismatch = OnMismatch::resync; }},
      {"match=sequence", [](auto&) {}},
      {"match=lookup,timing=none", [](auto& c) { c.match = Match::lookup, c.timing = Timing::none; }},
      {"at-end=idle", [](auto&) {}},
      {"at-end=hangup", [](auto& c) { c.at_end = AtEnd::hangup; }},
      {"at-end=exit", [](auto& c) { c.at_end = AtEnd::exit; }},
      {"at-end=loop", [](auto& c) { c.loops = 0; }},
      {"at-end=loop,loops=4", [](auto& c) { c.loops = 4; }},
      {"at-end=exit,loops=3", [](auto& c) { c.loops = 3, c.at_end = AtEnd::exit; }},
      {"start=1.5", [](auto& c) { c.start = tape_time_us(1'500'000); }},
      {"start=0.0000015", [](auto& c) { c.start = tape_time_us(2); }},
      {"end=2", [](auto& c) { c.end = tape_time_us(2'000'000); }},
      {"start=1,preroll", [](auto& c) { c.start = tape_time_us(1'000'000), c.preroll = true; }},
      {"max-gap=0.25", [](auto& c) { c.max_gap = Micros(250'000); }},
      {"on-reopen=auto", [](auto&) {}},
      {"on-reopen=rewind", [](auto& c) { c.on_reopen = OnReopen::rewind; }},
      {"on-reopen=continue", [](auto& c) { c.on_reopen = OnReopen::continue_; }},
      {"chunks=auto", [](auto&) {}},
      {"chunks=recorded", [](auto& c) { c.chunks = Chunks::recorded; }},
      {"chunks=burst", [](auto& c) { c.chunks = Chunks::burst; }},
      {"chunks=bytes", [](auto& c) { c.chunks = Chunks::bytes; }},
      {"chunks=random", [](auto& c) { c.chunks = Chunks::random; }},
      {"burst-gap=7", [](auto& c) { c.burst_gap = Micros(7); }},
      {"patience=0.5", [](auto& c) { c.patience = Micros(500'000); }},
      {"check-settings", [](auto& c) { c.check_settings = true; }},
      {"must-read", [](auto& c) { c.must_read = true; }},
  };
  for (const auto& [more, change] : known) {
    ReplayConfig config = options_of("," + more).config;
    ReplayConfig due = usual();
    change(due);
    config.chunk_seed = due.chunk_seed;
    EXPECT_TRUE(config == due) << more;
  }
  EXPECT_EQ(options_of(",chunks=random:77").config.chunk_seed, 77U);
  EXPECT_EQ(options_of(",chunks=random:77").config.chunks, Chunks::random);
  EXPECT_TRUE(options_of(",once").once);
  EXPECT_TRUE(options_of(",start-paused").start_paused);
  EXPECT_EQ(options_of(",session=3").session, 3U);
  EXPECT_EQ(options_of(",session=all").session, 0U);
  EXPECT_EQ(options_of(",report=r.json").report_file, "r.json");
  EXPECT_EQ(options_of(",junit=j.xml").junit_file, "j.xml");
}

TEST(ReplayOptions, WhatContradictsIsRefusedWithWhy) {
  const std::string no_order =
      ": a tape whose requests are looked up has no order; leave it out, or match=lookup and "
      "on-mismatch=resync";
  const std::string late =
      ", which is not behind the start (2 s); accepted: a later time of the tape, in seconds";
  const std::vector<std::pair<std::string, std::string>> known = {
      {"match=lookup",
       "option 'match': lookup answers what is asked, which timing=recorded does not wait for; use "
       "timing=reactive or none"},
      {"match=lookup,timing=reactive,strictness=2",
       "option 'strictness': 2 checks when each write comes, and with match=lookup it may come at any time; "
       "use strictness 1"},
      {"match=lookup,timing=none,check-settings",
       "option 'check-settings': settings are made in the tape's order, which match=lookup does not keep; "
       "leave one of them out"},
      {"start=2,end=2", "option 'end' is '2'" + late},
      {"start=2,end=1.5", "option 'end' is '1.5'" + late},
      {"on-mismatch=resync,start=1", "option 'start'" + no_order},
      {"on-mismatch=resync,loops=2", "option 'loops'" + no_order},
      {"match=lookup,timing=none,start=1,at-end=loop", "option 'loops'" + no_order},
      {"preroll", "option 'preroll' plays what precedes the option 'start', which is 0"},
      {"strictness=2,timing=none",
       "option 'strictness': 2 checks timing, which timing=none has not; use strictness 1 or another timing"},
      {"session=0",
       "option 'session' is '0'; accepted: all, or the number of one session of the tape, from 1 on"},
      {"session=x",
       "option 'session' is 'x'; accepted: all, or the number of one session of the tape, from 1 on"},
      {"report=t.logr", "report 't.logr' is a file of the tape; name another file"},
      {"junit=t.loge", "report 't.loge' is a file of the tape; name another file"},
      {"junit=./t.loge", "report './t.loge' is a file of the tape; name another file"},
      {"report=r,junit=./r", "option 'junit': './r' has the report already; name another file"},
      {"report=./r,junit=r", "option 'junit': 'r' has the report already; name another file"},
  };
  for (const auto& [more, why] : known) EXPECT_EQ(refusal_of("," + more), why);
  EXPECT_EQ(options_of(",start=2,end=2.000001").config.end, tape_time_us(2'000'001));
  EXPECT_EQ(options_of(",on-mismatch=resync,loops=1").config.loops, 1U);
  EXPECT_THAT(refusal_of(",rules=/no/such.rules"), HasSubstr("rules file '/no/such.rules': No such file"));
  Result<PortOptions> none = parse_options(replay_types(), "type=logreader,file=");
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_EQ(PortSpec::read(*none).error().message, "option 'file' is empty; accepted: the name of a tape");
}

TEST(ReplayOptions, ARulesFileIsRead) {
  const test::TempDir dir;
  test::write_file(dir / "my.rules",
                   as_bytes("[[frame]]\nprotocol='nmea'\n[[rule]]\nname='r'\nat=0\nignore=true\n"));
  EXPECT_NE(options_of(",rules=" + (dir / "my.rules")).expectation, nullptr);
}

// How each option is written.
std::vector<std::string> forms(const std::vector<OptionSpec>& options) {
  constexpr const char* kinds[] = {"text", "flag", "integer", "number", "choice"};
  std::vector<std::string> all;
  for (const OptionSpec& each : options) {
    std::string form = fmt::format("{} {}", each.name, kinds[static_cast<int>(each.kind)]);
    if (!each.default_value.empty()) form += fmt::format(" default {}", each.default_value);
    const bool is_number = each.kind == OptionSpec::Kind::integer || each.kind == OptionSpec::Kind::number;
    if (is_number) form += fmt::format(" {} to {}", each.min, each.max);
    if (!each.choices.empty()) form += fmt::format(" {}", fmt::join(each.choices, "|"));
    if (!each.value_name.empty()) form += fmt::format(" {}", each.value_name);
    if (!each.unit.empty()) form += fmt::format(" {}", each.unit);
    all.push_back(form);
  }
  return all;
}

TEST(ReplayOptions, AreWrittenSo) {
  const std::vector<std::string> all = forms(logreader_type().options);
  for (const char* const form : {
           "file text default port.log NAME",
           "strictness integer default 0 0 to 2",
           "jitter number default 100 0 to 1000000000 ms",
           "early-only flag",
           "ignoretimes flag",
           "timing choice default recorded reactive|recorded|none",
           "rate number default 1 1e-06 to 1000000 X",
           "on-mismatch choice default warn fail|warn|resync",
           "match choice default sequence sequence|lookup",
           "at-end choice default idle idle|hangup|exit|loop",
           "loops integer default 0 0 to 1000000000",
           "start number default 0 0 to 1000000000 SEC s",
           "end number 0 to 1000000000 SEC s",
           "preroll flag",
           "max-gap number 0 to 1000000000 SEC s",
           "start-paused flag",
           "on-reopen choice default auto auto|rewind|continue",
           "chunks choice default auto auto|recorded|burst|bytes|random[:SEED]",
           "burst-gap integer default 500 0 to 1000000000 us",
           "patience number default 1 0 to 1000000000 s",
           "check-settings flag",
           "must-read flag",
           "rules text FILE",
           "session text default all N|all",
           "once flag",
           "report text FILE",
           "junit text FILE",
       })
    EXPECT_THAT(all, testing::Contains(std::string(form)));
  EXPECT_THAT(forms(tape_options()), ElementsAre("file text default port.log NAME",
                                                 "on-existing choice default refuse refuse|next|overwrite",
                                                 "overwrite flag", "failclosed flag"));
}

TEST(ReplayOptions, AReportsFileIsClaimedUnlessItIsNone) {
  const PortType type = logreader_type();
  const auto claims = [&](const std::string& more) {
    const auto written = parse_options(replay_types(), "logreader:t.log" + more);
    std::string all;
    for (const auto& [kind, where] : type.claims(*PortSpec::read(*written))) all += kind + " " + where + ";";
    return all;
  };
  EXPECT_EQ(claims(""), "");
  EXPECT_EQ(claims(",report=a,junit=b"), "report a;report b;");
  EXPECT_EQ(claims(",report=-,junit=/dev/null"), "");
  EXPECT_EQ(claims(",report=/dev/stderr"), "");
}

TEST(ReplayOptions, WhereATapeIsPlayedDecidesSomeDefaults) {
  const auto all = [](ReplayUse use) {
    std::map<std::string, std::string> values = {{"timing", "none"}};
    set_replay_defaults(use, values);
    std::string text;
    for (const auto& [option, value] : values) text += option + "=" + value + " ";
    return text;
  };
  EXPECT_EQ(all(ReplayUse::verb), "strictness=1 timing=none ");
  EXPECT_EQ(all(ReplayUse::test), "on-mismatch=fail strictness=1 timing=none ");
  EXPECT_EQ(all(ReplayUse::drive), "on-mismatch=fail strictness=1 timing=none ");
  EXPECT_EQ(all(ReplayUse::in_process), "on-mismatch=fail timing=none ");
  EXPECT_EQ(all(ReplayUse::drop_in), "early-only=1 on-mismatch=fail timing=none ");
  EXPECT_EQ(replay_default(ReplayUse::verb, "timing", "x"), "reactive");
  EXPECT_EQ(replay_default(ReplayUse::verb, "on-mismatch", "x"), "x");
  EXPECT_EQ(replay_default(ReplayUse::in_process, "timing", "x"), "x");
  EXPECT_THAT(std::string(replay_help(ReplayUse::drive, "patience", "x")),
              HasSubstr("how long a recorded answer is waited for"));
  EXPECT_EQ(replay_help(ReplayUse::drive, "rate", "x"), "x");
  EXPECT_EQ(replay_help(ReplayUse::verb, "patience", "x"), "x");
}

TEST(ReplayOptions, ThoseOfTheDeviceAreOfNoUseToADriver) {
  for (const char* const option :
       {"at-end", "check-settings", "loops", "match", "must-read", "on-reopen", "once"})
    EXPECT_TRUE(is_of_device(option)) << option;
  for (const char* const option : {"timing", "on-mismatch", "start", ""})
    EXPECT_FALSE(is_of_device(option)) << option;
  EXPECT_TRUE(is_of_device("on-mismatch", "resync"));
  EXPECT_FALSE(is_of_device("on-mismatch", "fail"));
  EXPECT_FALSE(is_of_device("timing", "resync"));
}

TEST(RecordingOptionsTest, AreTheTapesAndTheRestIsThePorts) {
  PortType inner = logreader_type();
  inner.recorded_as = "both";
  const PortTypes types({recording_type(inner)});
  const auto options = [&](const std::string& more) {
    const auto written = parse_options(types, "both:t.log" + more);
    EXPECT_TRUE(written) << written.error().message;
    const auto spec = PortSpec::read(*written);
    EXPECT_TRUE(spec) << spec.error().message;
    return *spec->get<RecordingOptions>();
  };
  EXPECT_EQ(options("").tape.name(), "t.log");
  EXPECT_EQ(options("").on_existing, OnExisting::refuse);
  EXPECT_FALSE(options("").fail_closed);
  EXPECT_EQ(options(",on-existing=next").on_existing, OnExisting::next);
  EXPECT_EQ(options(",on-existing=overwrite").on_existing, OnExisting::overwrite);
  EXPECT_EQ(options(",overwrite").on_existing, OnExisting::overwrite);
  EXPECT_EQ(options(",on-existing=next,overwrite").on_existing, OnExisting::overwrite);
  EXPECT_TRUE(options(",failclosed").fail_closed);
  EXPECT_EQ(options(",rate=2,overwrite").inner.get<ReplayOptions>()->config.rate, 2);
  const PortType& type = types.all().front();
  EXPECT_EQ(type.records, "logreader");
  EXPECT_EQ(type.name, "both");
  const auto written = parse_options(types, "both:t.log,report=r");
  EXPECT_THAT(type.claims(*PortSpec::read(*written)),
              ElementsAre(std::pair(std::string("report"), std::string("r")),
                          std::pair(std::string("tape"), std::string("t.log"))));
}

}  // namespace
}  // namespace porttape
