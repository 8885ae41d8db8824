// Which runs count, and which is the worst.

#include "libport/replay/run_list.hpp"

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/error.hpp"

namespace porttape {
namespace {

RunReport run(Verdict verdict, std::uint64_t written = 3) {
  RunReport report;
  report.verdict = verdict;
  report.when = "2024-05-06T07:08:09.000010Z";
  report.duration = std::chrono::milliseconds(1500);
  report.to_driver_bytes = 7;
  report.from_driver_bytes = written;
  report.from_driver_of = 3;
  if (verdict == Verdict::data_mismatch) {
    report.mismatch.emplace();
    report.mismatch->offset = 2;
  }
  return report;
}

RunReport look() { return run(Verdict::incomplete, 0); }

RunReport nobody() {
  RunReport report = run(Verdict::pass, 0);
  report.from_driver_of = 0;
  report.nobody_came = true;
  return report;
}

boost::json::object parsed(const RunList& runs) { return boost::json::parse(to_json(runs)).as_object(); }

TEST(RunList, ATapeOfOneConnectionThatNobodyPlayedIsARunThatIsIncomplete) {
  for (RunReport missing : {look(), nobody()}) {
    RunList runs;
    RunReport first = run(Verdict::pass);
    first.connection = 1;
    missing.connection = 2;
    runs.add(missing);
    runs.add(first);
    EXPECT_EQ(runs.count(), 2U);
    EXPECT_EQ(runs.worst()->verdict, Verdict::incomplete);
    const auto json = parsed(runs);
    EXPECT_EQ(json.at("exit").as_int64(), exit_status::kIncomplete);
    EXPECT_EQ(json.at("connection").as_int64(), 1);
    const auto& list = json.at("runs").as_object().at("list").as_array();
    EXPECT_EQ(list.at(0).as_object().at("connection").as_int64(), 2);
    EXPECT_EQ(list.at(0).as_object().at("verdict").as_string(), "incomplete");
  }
}

TEST(RunList, SettingsComeBehindDataAndBeforeWhatIsMissing) {
  RunList runs;
  for (const Verdict verdict : {Verdict::incomplete, Verdict::settings_mismatch, Verdict::timing_mismatch,
                                Verdict::settings_mismatch}) {
    runs.add(run(verdict));
  }
  EXPECT_EQ(runs.worst()->verdict, Verdict::settings_mismatch);
  EXPECT_EQ(parsed(runs).at("exit").as_int64(), exit_status::kDataMismatch);
  runs.add(run(Verdict::extra));
  runs.add(run(Verdict::settings_mismatch));
  EXPECT_EQ(runs.worst()->verdict, Verdict::extra);
}

TEST(RunList, TheWorstRunCountsWhereverItIs) {
  RunList runs;
  for (const Verdict verdict : {Verdict::timing_mismatch, Verdict::data_mismatch, Verdict::pass})
    runs.add(run(verdict));
  EXPECT_EQ(runs.count(), 3U);
  EXPECT_EQ(runs.worst()->verdict, Verdict::data_mismatch);
  EXPECT_EQ(runs.latest()->verdict, Verdict::pass);
  EXPECT_EQ(runs.text(), "3 runs, the worst: data-mismatch");
  const auto json = parsed(runs);
  EXPECT_EQ(json.at("verdict").as_string(), "pass") << "the latest run's";
  EXPECT_EQ(json.at("exit").as_int64(), 3) << "what the program ends with";
  EXPECT_EQ(json.at("runs").at("worst").as_string(), "data-mismatch");
}

TEST(RunList, WhatIsWrongOutranksWhatIsMissingAndThatWhatIsLate) {
  RunList runs;
  runs.add(run(Verdict::timing_mismatch));
  runs.add(run(Verdict::incomplete));
  EXPECT_EQ(runs.worst()->verdict, Verdict::incomplete);
  runs.add(run(Verdict::extra));
  EXPECT_EQ(runs.worst()->verdict, Verdict::extra);
  RunReport damaged = run(Verdict::incomplete);
  damaged.trouble = "the tape is damaged";
  runs.add(damaged);
  EXPECT_EQ(exit_status_of(*runs.worst()), exit_status::kRuntime);
}

TEST(RunList, ALookIsNoRun) {
  RunList runs;
  runs.add(look());
  runs.add(run(Verdict::pass));
  runs.add(look());
  EXPECT_EQ(runs.count(), 1U);
  EXPECT_EQ(runs.looks(), 2U);
  EXPECT_EQ(runs.worst()->verdict, Verdict::pass);
  EXPECT_EQ(runs.latest()->verdict, Verdict::pass);
  EXPECT_EQ(runs.text(), "1 run, the worst: pass; 2 looks (opened, and nothing written)");
  EXPECT_EQ(parsed(runs).at("runs").at("list").as_array().size(), 1U);
}

TEST(RunList, NothingButLooksIsIncompleteAtAnyStrictness) {
  RunList runs;
  RunReport passed = look();
  passed.strictness = 0;
  passed.verdict = Verdict::pass;
  runs.add(passed);
  EXPECT_EQ(runs.count(), 0U);
  EXPECT_EQ(exit_status_of(*runs.worst()), exit_status::kIncomplete);
  const auto json = parsed(runs);
  EXPECT_EQ(json.at("verdict").as_string(), "incomplete");
  EXPECT_EQ(json.at("exit").as_int64(), 5);
  EXPECT_EQ(json.at("runs").at("looks").as_int64(), 1);
}

TEST(RunList, ThatNobodyCameIsIncomplete) {
  RunList runs;
  EXPECT_FALSE(runs.worst().has_value());
  runs.add(nobody());
  EXPECT_EQ(runs.count() + runs.looks(), 0U);
  EXPECT_EQ(runs.worst()->verdict, Verdict::incomplete);
  EXPECT_EQ(runs.text(), "no run, so the verdict is incomplete: nobody has opened the port");
  EXPECT_EQ(parsed(runs).at("runs").at("worst").as_string(), "incomplete");
}

TEST(RunList, WhoHasNothingToWriteRunsAllTheSame) {
  RunReport report = run(Verdict::pass, 0);
  report.from_driver_of = 0;
  EXPECT_FALSE(is_look(report));
  report.from_driver_of.reset();
  EXPECT_FALSE(is_look(report)) << "the tape was not counted, and nothing is known to be expected";
  report.next_expected = {1, 2};
  EXPECT_TRUE(is_look(report));
  report.next_expected.clear();
  report.undecided_from = 0;
  EXPECT_TRUE(is_look(report));
}

TEST(RunList, EachRunIsToldByWhatIdentifiesIt) {
  RunList runs;
  runs.add(run(Verdict::pass));
  runs.add(run(Verdict::data_mismatch));
  EXPECT_EQ(
      runs.json(),
      R"({"count":2,"looks":0,"worst":"data-mismatch","list":[)"
      R"({"verdict":"pass","exit":0,"when":"2024-05-06T07:08:09.000010Z","duration_s":1.5,"mismatch":null,)"
      R"("bytes":{"to_driver":7,"from_driver":3},"doubts":[]},)"
      R"({"verdict":"data-mismatch","exit":3,"when":"2024-05-06T07:08:09.000010Z","duration_s":1.5,)"
      R"("mismatch":{"kind":"data","offset":2},"bytes":{"to_driver":7,"from_driver":3},"doubts":[]}]})");
}

TEST(RunList, TheLatestThousandAreListedAndAllAreCounted) {
  RunList runs;
  runs.add(run(Verdict::data_mismatch));
  for (std::size_t n = 0; n < RunList::kMostListed; ++n) runs.add(run(Verdict::pass));
  EXPECT_EQ(runs.count(), RunList::kMostListed + 1);
  EXPECT_EQ(runs.worst()->verdict, Verdict::data_mismatch);
  const auto list = parsed(runs).at("runs").at("list").as_array();
  EXPECT_EQ(list.size(), RunList::kMostListed);
  EXPECT_EQ(list.front().at("verdict").as_string(), "pass");
}

}  // namespace
}  // namespace porttape
