#include "tools/suite_run.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <fnmatch.h>
#include <optional>
#include <span>
#include <stdexcept>
#include <unistd.h>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/replay/test_case.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_end.hpp"
#include "tools/job_pool.hpp"
#include "tools/option_description.hpp"
#include "tools/private_folder.hpp"
#include "tools/suite_file.hpp"
#include "tools/test_verdict.hpp"
#include "tools/text.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

double seconds_since(Instant begun) {
  return std::chrono::duration<double>(verb_clock().now() - begun).count();
}

// What a worker hands back of a test: these texts, each behind its length.
std::string packed(const TestCase& test, const std::string& report) {
  std::string out;
  const auto add = [&out](const std::string& text) { out += fmt::format("{}:{}", text.size(), text); };
  add(std::to_string(static_cast<int>(test.outcome)));
  add(std::to_string(test.exit_status));
  add(fmt::format("{}", test.seconds));
  for (const std::string* text : {&test.kind, &test.message.raw(), &test.text.raw(), &report}) add(*text);
  for (const StrangerText& doubt : test.doubts) add(doubt.raw());
  return out;
}

void unpack(std::string_view text, TestCase& test, std::string& report) {
  const auto next = [&text] {
    const std::size_t colon = text.find(':');
    const auto size = std::stoull(std::string(text.substr(0, colon)));
    const std::string one(text.substr(colon + 1, size));
    text.remove_prefix(colon + 1 + size);
    return one;
  };
  test.outcome = static_cast<TestCase::Outcome>(std::stoi(next()));
  test.exit_status = std::stoi(next());
  test.seconds = std::stod(next());
  test.kind = next();
  test.message = next();
  test.text = next();
  report = next();
  while (!text.empty()) test.doubts.emplace_back(next());
}

// In a worker, whose folder is the suite's.
TestVerdict run_in_worker(const SuiteTest& test, const std::map<std::string, std::string>& values) {
  const std::string& tape = test.values.at("tape");
  auto all = test.values;
  for (const auto& [name, value] : values) all[name] = value;
  PrivateFolder folder;
  if (!all.contains("driver")) {
    const Result<std::string> path = folder.make();
    if (!path) return no_test(tape, path.error());
    all["driver"] = "pty:" + *path + "/port";
  }
  Result<TestRequest> request = read_test(std::move(all), test.command);
  if (!request) return no_test(tape, request.error());
  request->looks_on = true;
  return run_one_test(*request);
}

std::string without_newline(std::string text) {
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

class SuiteRun {
 public:
  SuiteRun(const SuiteOptions& options, Suite suite, std::ostream& out, std::ostream& err)
      : options_(options),
        suite_(std::move(suite)),
        out_(out),
        err_(err),
        colors_(wants_color(out, options.color)),
        shows_progress_(options.format == TestFormat::text && ::isatty(STDERR_FILENO) == 1) {
    name_ = std::filesystem::weakly_canonical(suite_.folder).filename().string();
    cases_.resize(suite_.tests.size());
    reports_.resize(suite_.tests.size());
  }

  Result<int> run() {
    for (const std::string& note : suite_.notes)
      fmt::print(err_, "porttape test: {}\n", printable_line(note));
    if (options_.format == TestFormat::tap) out_ << tap_head(suite_.tests.size()) << std::flush;
    if (Result<void> ran = run_tests(); !ran) return ran.error();
    for (std::size_t i = 0; i < cases_.size(); ++i) {
      if (!cases_[i]) finish(i, not_run(i));
    }
    clear_progress();
    if (const Result<void> written = write_junit(); !written) {
      trouble_ = written.error().message;
      worst_ = worse_exit_status(worst_, exit_status_of(written.error().code));
      fmt::print(err_, "porttape test: {}\n", printable_lines(trouble_));
    }
    end_output();
    return exit_status();
  }

 private:
  Result<void> run_tests() {
    const auto work = [this](const std::string& job) {
      enter_folder();
      const std::size_t index = std::stoul(job);
      const TestVerdict verdict = run_in_worker(suite_.tests[index], options_.values);
      return packed(verdict.as_case("", ""), without_newline(verdict.json()));
    };
    auto pool = JobPool::make({.workers = options_.jobs, .work = work});
    if (!pool) return pool.error();
    for (std::size_t i = 0; i < suite_.tests.size(); ++i) {
      if (suite_.tests[i].skip.empty()) {
        (*pool)->add(std::to_string(i));
        jobs_.push_back(i);
      } else {
        finish(i, skipped(i, suite_.tests[i].skip));
      }
    }
    while (auto done = (*pool)->wait()) take(std::move(*done));
    interrupted_by_ = (*pool)->interrupted_by();
    return {};
  }

  // Of a worker, for all its tests.
  void enter_folder() {
    if (std::exchange(entered_, true) || ::chdir(suite_.folder.c_str()) == 0) return;
    const int error = errno;
    entered_ = false;
    throw std::runtime_error("folder " + in_quotes(suite_.folder) + ": " + errno_text(error));
  }

  void take(JobDone done) {
    const std::size_t index = jobs_.at(done.job);
    TestCase test = {.name = suite_.tests[index].name, .group = name_};
    if (done.trouble.empty()) {
      unpack(done.result, test, reports_[index]);
    } else {
      test.outcome = TestCase::Outcome::error;
      test.exit_status = exit_status::kRuntime;
      test.kind = "failed";
      test.message = done.trouble;
      test.text = done.trouble + '\n';
    }
    test.output = std::move(done.output);
    finish(index, std::move(test));
  }

  [[nodiscard]] TestCase skipped(std::size_t index, const StrangerText& why) const {
    return {.name = suite_.tests[index].name,
            .group = name_,
            .outcome = TestCase::Outcome::skipped,
            .message = why};
  }

  [[nodiscard]] TestCase not_run(std::size_t index) const {
    return skipped(index, "not run: interrupted by " + signal_text(interrupted_by_));
  }

  void finish(std::size_t index, TestCase test) {
    counts_.add(test);
    if (test.outcome != TestCase::Outcome::skipped && test.exit_status != exit_status::kPass)
      worst_ = worse_exit_status(worst_, test.exit_status);
    cases_[index] = std::move(test);
    switch (options_.format) {
      case TestFormat::text:
        tell_text(*cases_[index]);
        return;
      case TestFormat::json:
        out_ << json_of(*cases_[index], reports_[index]).str() << '\n' << std::flush;
        return;
      case TestFormat::tap:
        tell_tap();
    }
  }

  // TAP's tests are told in their order.
  void tell_tap() {
    for (; next_ < cases_.size() && cases_[next_]; ++next_) out_ << tap_of(*cases_[next_], next_ + 1);
    out_.flush();
  }

  void tell_text(const TestCase& test) {
    if (test.outcome == TestCase::Outcome::failed || test.outcome == TestCase::Outcome::error) {
      clear_progress();
      fmt::print(out_, "{}{}{}  {}\n", color_begin(Color::bad, colors_), "FAIL", color_end(colors_),
                 test.name.for_line());
      tell_lines(test.text.raw());
      if (!test.output.empty()) tell_lines("what the command wrote:\n" + last_lines(test.output.raw()));
      const std::vector<std::string> again = {"porttape",      "test",   "--suite",
                                              options_.folder, "--only", test.name.raw()};
      fmt::print(out_, "    again     {}\n", shell_line(again));
      out_.flush();
    } else if (!test.doubts.empty()) {
      clear_progress();
      fmt::print(out_, "{}pass{}, with doubts  {}\n", color_begin(Color::doubtful, colors_),
                 color_end(colors_), test.name.for_line());
      for (const StrangerText& doubt : test.doubts) fmt::print(out_, "    doubt     {}\n", doubt.for_line());
      out_.flush();
    }
    tell_progress();
  }

  void tell_lines(std::string_view text) {
    while (!text.empty()) {
      const std::size_t end = text.find('\n');
      fmt::print(out_, "    {}\n", printable_line(text.substr(0, end)));
      text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    }
  }

  static std::string last_lines(std::string_view text) {
    constexpr int most = 20;
    std::size_t from = text.size();
    for (int lines = 0; lines <= most && from != std::string_view::npos && from > 0; ++lines)
      from = text.rfind('\n', from - 1);
    const bool all = from == std::string_view::npos || from == 0;
    return all ? std::string(text) : "..." + std::string(text.substr(from));
  }

  void tell_progress() {
    if (!shows_progress_) return;
    fmt::print(err_, "\r\x1b[K{} of {}, {} failed, {:.0f} s", counts_.all(), cases_.size(),
               counts_.failed + counts_.errors, seconds_since(begun_));
    err_.flush();
  }

  void clear_progress() {
    if (shows_progress_) err_ << "\r\x1b[K" << std::flush;
  }

  void end_output() {
    const double seconds = seconds_since(begun_);
    const std::string why = "interrupted by " + signal_text(interrupted_by_);
    if (options_.format == TestFormat::tap && interrupted_by_ != 0) {
      out_ << tap_bail_out(why);
    } else if (options_.format == TestFormat::tap && !trouble_.empty()) {
      out_ << tap_bail_out(trouble_);
    }
    if (options_.format == TestFormat::json) {
      JsonObject sum;
      sum.add("suite", options_.folder)
          .add("exit", exit_status())
          .add("tests", counts_.all())
          .add("passed", counts_.passed)
          .add("doubtful", counts_.doubtful)
          .add("failed", counts_.failed)
          .add("errors", counts_.errors)
          .add("skipped", counts_.skipped)
          .add("duration_s", seconds);
      if (!trouble_.empty()) sum.add("trouble", trouble_);
      out_ << sum.str() << '\n';
    }
    if (options_.format == TestFormat::text) {
      const bool good = exit_status() == exit_status::kPass;
      fmt::print(out_, "{}{}{}  {}: {}, {} passed{}, {} failed, {} skipped, {:.2f} s\n",
                 color_begin(good ? Color::good : Color::bad, colors_),
                 interrupted_by_ != 0 ? why
                 : !trouble_.empty()  ? "failed: " + printable_line(trouble_)
                 : good               ? "pass"
                                      : "failed",
                 color_end(colors_), printable_line(name_), counted(counts_.all(), "test"), counts_.passed,
                 counts_.doubtful > 0 ? fmt::format(" ({} with doubts)", counts_.doubtful) : "",
                 counts_.failed + counts_.errors, counts_.skipped, seconds);
    }
    out_.flush();
  }

  Result<void> write_junit() {
    if (options_.junit_file.empty()) return {};
    std::vector<TestCase> all;
    for (auto& test : cases_) all.push_back(*test);
    mode_t kept = 0;
    for (const SuiteTest& test : suite_.tests) {
      const std::filesystem::path name = std::filesystem::path(suite_.folder) / test.values.at("tape");
      if (const Result<TapePaths> tape = find_tape(name.string())) kept |= kept_from_others(*tape);
    }
    return write_report(options_.junit_file, to_junit(name_, all, seconds_since(begun_)), "report", kept);
  }

  [[nodiscard]] int exit_status() const { return interrupted_by_ != 0 ? 128 + interrupted_by_ : worst_; }

  const SuiteOptions& options_;
  Suite suite_;
  std::ostream& out_;
  std::ostream& err_;
  std::string name_;
  Instant begun_ = verb_clock().now();
  bool colors_;
  bool shows_progress_;
  bool entered_ = false;           // in a worker: its folder is the suite's
  std::vector<std::size_t> jobs_;  // which test each is
  std::vector<std::optional<TestCase>> cases_;
  std::vector<std::string> reports_;  // JSON
  TestCounts counts_;
  std::size_t next_ = 0;
  int worst_ = exit_status::kPass;
  int interrupted_by_ = 0;
  std::string trouble_;  // the JUnit file could not be written; else empty
};

// Leaves those that --only names.
Result<void> choose(Suite& suite, const std::string& only) {
  if (only.empty()) return {};
  std::erase_if(suite.tests, [&only](const SuiteTest& test) {
    return test.name != only && ::fnmatch(only.c_str(), test.name.raw().c_str(), 0) != 0;
  });
  suite.notes.clear();
  if (!suite.tests.empty()) return {};
  return make_error(Errc::usage,
                    fmt::format("suite {} has no test {}; --only takes a name, or a pattern such "
                                "as 'laser*'",
                                in_quotes(suite.folder), in_quotes(only)));
}

// Where no test can be run the files and the format of all of them say so: nothing of an earlier run stays.
Error cannot_begin(const SuiteOptions& options, Error why, std::ostream& out) {
  if (!options.junit_file.empty()) {
    const std::string name = std::filesystem::weakly_canonical(options.folder).filename().string();
    const TestCase none = no_test(options.folder, why).as_case("suite", name);
    if (Result<void> written = write_report(options.junit_file, to_junit(name, std::span(&none, 1), 0));
        !written)
      why.message += "; " + written.error().message;
  }
  if (options.format == TestFormat::tap) out << tap_bail_out(why.message) << std::flush;
  return why;
}

}  // namespace

Result<int> run_suite(const SuiteOptions& options, std::ostream& out, std::ostream& err) {
  if (!options.junit_file.empty()) {
    if (Result<void> place = check_report_place(options.junit_file); !place) return place.error();
  }
  Result<Suite> suite = read_suite(options.folder, options.values);
  if (!suite) return cannot_begin(options, suite.error(), out);
  if (Result<void> chosen = choose(*suite, options.only); !chosen)
    return cannot_begin(options, chosen.error(), out);
  return SuiteRun(options, std::move(*suite), out, err).run();
}

}  // namespace porttape
