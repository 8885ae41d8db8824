#include <algorithm>
#include <array>
#include <csignal>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/replay/test_case.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/cassette_verbs.hpp"
#include "tools/command_verb.hpp"
#include "tools/output.hpp"
#include "tools/record_mode.hpp"
#include "tools/suite_run.hpp"
#include "tools/test_lines.hpp"
#include "tools/test_request.hpp"
#include "tools/test_verdict.hpp"
#include "tools/verbs.hpp"
#include "tools/verdict_view.hpp"

namespace porttape {
namespace {

constexpr std::string_view kTestAbout =
    "Runs COMMAND against a tape in the device's place and prints the verdict.\n"
    "`porttape test --suite DIR` does so for the tests that DIR/suite.toml names.\n\n"
    "Exit status: 0 pass, 1 failure at run time or of the command itself, 2 wrong\n"
    "use, 3 other data, 4 other timing, 5 incomplete; 130 and 143 when interrupted.\n"
    "Of a suite: the worst of its tests.\n\n";

std::vector<OptionSpec> verb_options() {
  std::vector<OptionSpec> specs = test_options();
  specs.push_back({.name = "suite",
                   .help = "the tests of this folder, as its suite.toml has them, instead of one",
                   .value_name = "DIR"});
  specs.push_back({.name = "jobs",
                   .kind = OptionSpec::Kind::integer,
                   .help = "of a suite: tests at the same time; by default one for each processor",
                   .min = 1,
                   .max = 1000});
  specs.push_back(
      {.name = "only", .help = "of a suite: the tests of this name, such as 'laser*'", .value_name = "NAME"});
  specs.push_back(record_mode_option());
  const std::vector<OptionSpec> record = channel_options(ChannelMode::record);
  specs.push_back(*std::ranges::find(record, "device", &OptionSpec::name));
  specs.back().help = "with --record-mode once: where a tape that is not there is recorded from";
  for (OptionSpec& view : view_options()) specs.push_back(std::move(view));
  return specs;
}

std::optional<std::string> take(CommandVerbLine& line, const char* option) {
  const auto given = line.values.extract(option);
  return given ? std::optional(given.mapped()) : std::nullopt;
}

Result<int> run_suite_of(CommandVerbLine line, const VerdictView& view, std::ostream& out,
                         std::ostream& err) {
  for (const char* option : {"tape", "driver", "report", "device", "record-mode"}) {
    if (line.values.contains(option))
      return make_error(Errc::usage,
                        fmt::format("option '{}' is of one test, and does not go with --suite", option));
  }
  if (!line.command.empty())
    return make_error(Errc::usage, "a suite has its commands in suite.toml; leave out what is behind --");
  SuiteOptions options{.folder = *take(line, "suite"),
                       .jobs = std::max(1U, std::thread::hardware_concurrency()),
                       .only = take(line, "only").value_or(""),
                       .junit_file = take(line, "junit").value_or(""),
                       .format = view.format,
                       .color = view.color};
  if (const auto jobs = take(line, "jobs")) {
    const std::vector<OptionSpec> specs = verb_options();
    const Result<std::string> checked =
        check_value(*std::ranges::find(specs, "jobs", &OptionSpec::name), *jobs);
    if (!checked) return checked.error();
    options.jobs = *whole_number<std::size_t>(*checked);
  }
  options.values = std::move(line.values);
  return run_suite(options, out, err);
}

// What the report says to type next.
struct NextLines {
  std::string repeat;
  std::string step;
};

TestVerdict run_line(CommandVerbLine line, const VerdictView& view, const NextLines& next) {
  const std::string tape = line.values.contains("tape") ? line.values.at("tape") : "";
  Result<TestRequest> request = read_test(std::move(line.values), std::move(line.command));
  if (!request) return no_test(tape, request.error());
  request->output_to_stderr = view.format != TestFormat::text;
  request->repeat_line = next.repeat;
  request->step_line = next.step;
  request->looks_on = true;
  return run_one_test(*request);
}

Result<int> run_single(CommandVerbLine line, const VerdictView& view, const NextLines& next,
                       std::ostream& out, std::ostream& err) {
  for (const char* option : {"jobs", "only"}) {
    if (line.values.contains(option))
      return make_error(Errc::usage, fmt::format("option '{}' goes with --suite DIR", option));
  }
  const auto file = [&line](const char* option) {
    const auto given = line.values.find(option);
    return given == line.values.end() ? std::string() : given->second;
  };
  const ReportFiles files{.verb = "porttape test", .report = file("report"), .junit = file("junit")};
  TestVerdict verdict = run_line(std::move(line), view, next);
  for (const std::string& note : verdict.notes) fmt::print(err, "porttape test: {}\n", printable_line(note));
  return end_test(std::move(verdict), view, files, out, err);
}

// What of a recording's status is a test's. The command's own, which record ends with, is told there, and
// here is no verdict.
int status_of_recorded(int status) {
  constexpr std::array kOwn{exit_status::kPass, exit_status::kRuntime, exit_status::kDevice, 128 + SIGINT,
                            128 + SIGTERM};
  return std::ranges::find(kOwn, status) == kOwn.end() ? exit_status::kRuntime : status;
}

// Faults are for the test, and not on what it is held against from then on. Where there is no tape then, the
// test was none.
Result<int> record_cassette(CommandVerbLine line, std::ostream& err) {
  const std::string junit = take(line, "junit").value_or("");
  const std::string tape = line.values.at("tape");
  const bool faults = line.values.erase("faults") + line.values.erase("seed") > 0;
  if (faults) fmt::print(err, "porttape test: the tape is recorded now, without the faults\n");
  line.values = values_to_record(std::move(line.values));
  Result<int> status = record_command(std::move(line), err);
  if (status) status = status_of_recorded(*status);
  if (status && *status == exit_status::kPass && !find_tape(tape)) {
    fmt::print(err, "porttape test: incomplete: nothing was recorded\n");
    status = exit_status::kIncomplete;
  }
  if (junit.empty()) return status;
  const bool recorded = status && *status == exit_status::kPass;
  const Error why = status ? make_error(Errc::io, "the tape could not be recorded") : status.error();
  TestCase none = no_test(tape, why).as_case(tape, "porttape test");
  if (recorded) {
    none = {.name = tape,
            .group = none.group,
            .outcome = TestCase::Outcome::skipped,
            .message = "the tape was recorded; the next run is a test"};
  }
  if (Result<void> written = write_report(junit, to_junit("porttape test", std::span(&none, 1), 0));
      !written && status)
    return written.error();
  return status;
}

// A tape that is missing is recorded, where that was asked for.
Result<int> run_cassette(CommandVerbLine line, const VerdictView& view, const NextLines& next,
                         std::ostream& out, std::ostream& err) {
  if (line.values.contains("record-mode")) {
    const Result<Cassette> cassette = choose_cassette(line.values);
    if (!cassette) return cassette.error();
    if (!cassette->note.empty()) fmt::print(err, "porttape test: {}\n", cassette->note);
    if (cassette->records) return record_cassette(std::move(line), err);
  }
  line.values = values_to_play(std::move(line.values));
  return run_single(std::move(line), view, next, out, err);
}

}  // namespace

Result<int> play_command(CommandVerbLine line, std::ostream& out, std::ostream& err) {
  return run_single(std::move(line), {}, {}, out, err);
}

int run_test(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "test",
                         .usage = "--tape NAME [options] -- COMMAND…",
                         .about = kTestAbout,
                         .options = verb_options(),
                         .example = "--tape laser -- ./laser_driver --device {port}",
                         .alone = "suite"};
  return run_command_verb(verb, args, out, err, [&](CommandVerbLine line) -> Result<int> {
    const Result<VerdictView> view = take_view(line.values);
    if (!view) return view.error();
    return line.values.contains("suite")
               ? run_suite_of(std::move(line), *view, out, err)
               : run_cassette(std::move(line), *view, {repeat_line(args), step_line(args)}, out, err);
  });
}

}  // namespace porttape
