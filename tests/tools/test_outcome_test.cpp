// Under `porttape test`: one outcome, and the status that goes with it.
#include "tools/test_outcome.hpp"

#include <signal.h>

#include <gtest/gtest.h>

#include "tools/option_description.hpp"

namespace porttape {
namespace {

RunReport with(Verdict verdict, const TestEnd& end) {
  RunReport report;
  report.verdict = verdict;
  report.command_exit = end.command.exit_code();
  return report;
}

struct Outcome {
  int status = 0;
  std::string text;
  std::string command;
  friend bool operator==(const Outcome&, const Outcome&) = default;
};

Outcome outcome(Verdict verdict, const TestEnd& end) {
  const RunReport report = with(verdict, end);
  return {exit_status_of(report, end), outcome_text(report, end), command_end_text(report, end)};
}

TEST(TestOutcome, TheVerdictSpeaksForItself) {
  EXPECT_EQ(outcome(Verdict::pass, {}), (Outcome{0, "", ""}));
  EXPECT_EQ(outcome(Verdict::data_mismatch, {}), (Outcome{3, "", ""}));
}

TEST(TestOutcome, ACommandThatFailedAfterAPassIsTheOutcome) {
  EXPECT_EQ(outcome(Verdict::pass, {.command = {.status = 1}}),
            (Outcome{1, "failed: the driver did all as recorded, but the command ended with status 1", ""}));
  EXPECT_EQ(
      outcome(Verdict::pass, {.command = {.signal = SIGSEGV}}),
      (Outcome{1, "failed: the driver did all as recorded, but the command was ended by SIGSEGV (11)", ""}));
}

TEST(TestOutcome, AfterAnotherVerdictItIsOnlyTold) {
  EXPECT_EQ(outcome(Verdict::timing_mismatch, {.command = {.status = 7}}),
            (Outcome{4, "", "ended with status 7"}));
}

TEST(TestOutcome, ACommandThatFailedOnALineHungUpIsToldWhy) {
  const TestEnd end{.command = {.status = 1}, .hung_up = true};
  EXPECT_EQ(outcome(Verdict::data_mismatch, end).command,
            "ended with status 1; its line was hung up there (--on-mismatch warn goes on)");
}

TEST(TestOutcome, ACommandThatWasEndedFails) {
  const TestEnd end{.command = {.signal = SIGTERM},
                    .ended_because = "ran longer than --timeout and was ended"};
  EXPECT_EQ(outcome(Verdict::pass, end),
            (Outcome{1, "failed: the driver did all as recorded, but the command " + end.ended_because, ""}));
  EXPECT_EQ(outcome(Verdict::incomplete, end), (Outcome{5, "", end.ended_because}));
}

TEST(TestOutcome, AnInterruptOutranksAll) {
  EXPECT_EQ(outcome(Verdict::pass, {.command = {.signal = SIGINT}, .interrupted_by = SIGINT}),
            (Outcome{130, "interrupted by SIGINT (2)", ""}));
  EXPECT_EQ(outcome(Verdict::data_mismatch, {.command = {.status = 1}, .interrupted_by = SIGTERM}),
            (Outcome{143, "interrupted by SIGTERM (15)", ""}));
}

TEST(TestOutcome, WhatWentWrongBesideTheRunsIsTheOutcome) {
  const std::string text = "failed: not all connections had their run; what went wrong is told above";
  EXPECT_EQ(outcome(Verdict::pass, {.session_status = 1}), (Outcome{1, text, ""}));
  EXPECT_EQ(outcome(Verdict::data_mismatch, {.session_status = 2}), (Outcome{2, text, ""}));
  EXPECT_EQ(outcome(Verdict::incomplete, {.command = {.status = 3}, .opened = false, .session_status = 1}),
            (Outcome{1, text, "ended with status 3"}));
  EXPECT_EQ(outcome(Verdict::pass, {.interrupted_by = SIGINT, .session_status = 1}).status, 130);
}

TEST(TestOutcome, AVerdictOrALostDeviceOfTheSessionsIsNotToldTwice) {
  for (const int status : {3, 4, 5, 6})
    EXPECT_EQ(outcome(Verdict::pass, {.session_status = status}), (Outcome{0, "", ""}));
}

TEST(TestOutcome, ADamagedTapeOutranksAPortThatWasNeverOpened) {
  RunReport report = with(Verdict::incomplete, {});
  report.trouble = "laser.logr: damaged";
  const TestEnd end{.opened = false};
  EXPECT_EQ(exit_status_of(report, end), 1);
  EXPECT_EQ(outcome_text(report, end), "");
}

TEST(TestOutcome, APortThatWasNeverOpened) {
  EXPECT_EQ(outcome(Verdict::incomplete, {.command = {.status = 1}, .opened = false}),
            (Outcome{5, "incomplete: the command never opened its port", "ended with status 1"}));
}

TEST(CommandEnd, AShellsStatusNamesTheSignal) {
  EXPECT_EQ(CommandEnd{.status = 139}.text(), "ended with status 139, a shell's for SIGSEGV (11)");
  EXPECT_EQ(CommandEnd{.status = 255}.text(), "ended with status 255");
  EXPECT_EQ(CommandEnd{.signal = 9}.exit_code(), 137);
}

TEST(ShellLine, QuotesWhatAShellWouldTakeApart) {
  EXPECT_EQ(shell_line(std::vector<std::string>{"python3", "a.py", "--port={port}"}),
            "python3 a.py --port={port}");
  EXPECT_EQ(shell_line(std::vector<std::string>{"sh", "-c", "echo 'x' >{port}", ""}),
            "sh -c 'echo '\\''x'\\'' >{port}' ''");
}

}  // namespace
}  // namespace porttape
