#include "tools/fault_run.hpp"

#include <gtest/gtest.h>

#include "tools/fault_case.hpp"

namespace porttape {
namespace {

TEST(FaultRun, JobsAndEndsGoThroughAPipe) {
  const FaultRunJob job{.tape = "a b.log",
                        .faults = "drop:p=0.5",
                        .seed = 7,
                        .tracks = true,
                        .exact = false,
                        .enough = 3,
                        .ends_at_unknown = true};
  EXPECT_EQ(fault_run_job(to_text(job)), job);
  EXPECT_EQ(fault_run_job(to_text(FaultRunJob{})), FaultRunJob{});
  const FaultRunEnd end{.status = 1,
                        .signal = 2,
                        .ended_because = "slept \"long\"",
                        .verdict = "pass",
                        .passed = true,
                        .enough = true,
                        .faults = {"drop:byte=1", "hangup:at=2"},
                        .faults_made = 2,
                        .bytes = 12,
                        .turns = {{0, 1, 2}, {3, 4, 5}},
                        .reach = 9,
                        .beyond = true,
                        .unknown_hex = "0aff"};
  EXPECT_EQ(fault_run_end(to_text(end)), end);
  EXPECT_EQ(fault_run_end(to_text(FaultRunEnd{})), FaultRunEnd{});
}

TEST(FaultRun, WhatCountsAsAFailure) {
  using By = FaultCase::FailsBy;
  const auto kind = [](const FaultRunEnd& end, By by) {
    const auto failure = failure_of(end, by);
    return failure ? failure->kind : "none";
  };
  const FaultRunEnd good{.verdict = "pass", .passed = true};
  const FaultRunEnd mismatch{.verdict = "data-mismatch"};
  const FaultRunEnd status{.status = 3, .verdict = "pass", .passed = true};
  const FaultRunEnd crash{.signal = 11, .verdict = "pass", .passed = true};
  const FaultRunEnd hung{.signal = 15, .ended_because = "slept for 10 s", .verdict = "pass"};
  EXPECT_EQ(kind(good, By::verdict), "none");
  EXPECT_EQ(kind(mismatch, By::status), "none") << "a driver that asks again is none";
  EXPECT_EQ(kind(mismatch, By::verdict), "verdict data-mismatch");
  EXPECT_EQ(kind(status, By::signal), "none");
  EXPECT_EQ(kind(status, By::status), "status 3");
  EXPECT_EQ(kind(crash, By::signal), "signal 11");
  EXPECT_EQ(kind(hung, By::signal), "hung");
}

TEST(FaultRun, OfItsOutputTheLastLinesAreShown) {
  EXPECT_EQ(last_lines(""), "");
  EXPECT_EQ(last_lines("a\n\nb\x1b\n"), "    a\n    b\\x1b\n");
  EXPECT_EQ(last_lines("1\n2\n3\n4\n5\n6\n7\n8\n9\n"),
            "    2\n    3\n    4\n    5\n    6\n    7\n    8\n    9\n");
}

}  // namespace
}  // namespace porttape
