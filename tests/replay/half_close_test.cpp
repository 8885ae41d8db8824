// A half-close on the tape: the device's lets the driver see the end, the driver's is a gate.

#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape {
namespace {

using test::kSocket;
using test::MemoryTape;
using test::Rig;

Rig rig_of(const MemoryTape& tape, const ReplayConfig& config = {}, const Engine::Parts& parts = kSocket) {
  return Rig(tape, config, true, std::numeric_limits<std::size_t>::max(), parts);
}

// The driver asks, ends its sending, and is answered.
MemoryTape asks_and_ends() {
  return MemoryTape()
      .open(0)
      .write(1'000, "ask")
      .half_close(2'000, Side::driver)
      .read(5'000, "answer")
      .close(9'000);
}

// The device greets, ends its sending, and reads on.
MemoryTape greets_and_ends() {
  return MemoryTape()
      .open(0)
      .read(1'000, "hello")
      .half_close(4'000, Side::device)
      .write(6'000, "bye")
      .close(9'000);
}

TEST(HalfClose, TheDevicesIsToldWhenItIsDueAndTheDriverMayWriteOn) {
  Rig rig = rig_of(greets_and_ends());
  rig.open().until(3'999);
  EXPECT_EQ(rig.read(), "hello");
  EXPECT_FALSE(rig.ended);
  rig.until(4'000);
  EXPECT_TRUE(rig.ended);
  EXPECT_FALSE(rig.hung_up);
  rig.write("bye").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(HalfClose, TheDevicesWaitsForTheDriversQuestion) {
  Rig rig = rig_of(MemoryTape().open(0).write(1'000, "ask").half_close(3'000, Side::device).close(9'000));
  rig.open().until(50'000);
  EXPECT_FALSE(rig.ended);
  rig.write("ask").wait(1'999);
  EXPECT_FALSE(rig.ended);
  rig.wait(1);
  EXPECT_TRUE(rig.ended);
}

TEST(HalfClose, TheDevicesWaitsForALineThatTakesNothing) {
  Rig rig = rig_of(greets_and_ends());
  rig.blocked(true).open().until(20'000);
  EXPECT_FALSE(rig.ended);
  rig.blocked(false);
  EXPECT_EQ(rig.read(), "hello");
  EXPECT_TRUE(rig.ended);
}

TEST(HalfClose, WhatFollowsTheDriversIsTimedFromTheDriversOwn) {
  Rig rig = rig_of(asks_and_ends());
  rig.open().write("ask").until(500'000);
  EXPECT_EQ(rig.read(), "");
  rig.end_writing().wait(2'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "answer");
  EXPECT_TRUE(rig.hung_up) << "nothing more comes to a driver that writes no more";
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_FALSE(rig.report->missed_half_close.has_value());
}

TEST(HalfClose, ADriverThatDoesNotMakeItIsAnsweredByPatienceAndIncomplete) {
  for (const OnMismatch on_mismatch : {OnMismatch::warn, OnMismatch::fail}) {
    Rig rig = rig_of(asks_and_ends(), {.on_mismatch = on_mismatch});
    rig.open().write("ask").until(900'000);
    EXPECT_EQ(rig.read(), "");
    rig.until(1'100'000);
    EXPECT_EQ(rig.read(), "answer");
    rig.close();
    EXPECT_EQ(rig.verdict(), Verdict::incomplete);
    EXPECT_EQ(rig.report->missed_half_close, tape_time_us(2'000));
    const std::string text = to_text(*rig.report);
    EXPECT_NE(text.find("the driver ends its sending (half-close) at 0.002"), std::string::npos) << text;
    EXPECT_EQ(text.find("never came"), std::string::npos) << text;
  }
}

TEST(HalfClose, ADriverThatMakesItLateHasMadeIt) {
  Rig rig = rig_of(asks_and_ends());
  rig.open().write("ask").until(1'500'000);
  EXPECT_EQ(rig.read(), "answer") << "by patience";
  rig.end_writing().wait(10);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_FALSE(rig.report->missed_half_close.has_value());
}

TEST(HalfClose, AtStrictness0ItIsToldAndNoFault) {
  Rig rig = rig_of(asks_and_ends(), {.strictness = 0});
  rig.open().write("ask").until(2'000'000).close();
  EXPECT_EQ(rig.read(), "answer");
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_TRUE(rig.report->missed_half_close.has_value());
}

TEST(HalfClose, ACloseIsAnEndOfWritingToo) {
  Rig rig = rig_of(asks_and_ends());
  rig.open().write("ask").wait(10).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(HalfClose, WhereTheLineHasNoneItIsPassedBy) {
  Rig rig = rig_of(asks_and_ends(), {}, {});
  rig.open().write("ask").until(5'000);
  EXPECT_EQ(rig.read(), "answer");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(HalfClose, ByTheRecordedClockItHoldsNothingUp) {
  Rig rig = rig_of(asks_and_ends(), {.timing = Timing::recorded});
  rig.open().until(1'000).write("ask").until(5'000);
  EXPECT_EQ(rig.read(), "answer");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(HalfClose, EachSessionHasItsOwn) {
  MemoryTape tape = asks_and_ends();
  tape.open(100'000)
      .write(101'000, "again")
      .half_close(102'000, Side::driver)
      .read(103'000, "yes")
      .close(109'000);
  Rig rig = rig_of(tape);
  rig.open().write("ask").end_writing().wait(10'000).close();
  EXPECT_EQ(rig.read(), "answer");
  rig.open().write("again").wait(500'000);
  EXPECT_EQ(rig.read(), "") << "the first session's end is not the second's";
  rig.end_writing().wait(10'000).close();
  EXPECT_EQ(rig.read(), "yes");
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

}  // namespace
}  // namespace porttape
