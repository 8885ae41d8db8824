// The values that the keys of a fault take: each at its limit, and one beyond.

#include "libport/faults/fault_keys.hpp"

#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "libport/faults/fault_plan.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::seconds;

bool takes(const std::string& text) { return parse_fault_plan(text, {}).has_value(); }

Fault fault(const std::string& text) {
  const Result<FaultPlan> plan = parse_fault_plan(text, {});
  if (plan) return plan->faults.front();
  ADD_FAILURE() << plan.error().message;
  return {};
}

std::string again(const std::string& text) {
  const Result<FaultPlan> plan = parse_fault_plan(text, {});
  return plan ? plan->text() : plan.error().message;
}

TEST(FaultKeys, AProbabilityIsZeroToOne) {
  EXPECT_EQ(fault("drop:p=0").chance, 0);
  EXPECT_EQ(fault("drop:p=1").chance, 1);
  EXPECT_FALSE(takes("drop:p=1.000001"));
  EXPECT_FALSE(takes("drop:p=-0.000001"));
  EXPECT_FALSE(takes("drop:p=0.5x"));
}

TEST(FaultKeys, AnOffsetIsZeroOrMore) {
  EXPECT_EQ(fault("drop:byte=0").position, 0U);
  EXPECT_EQ(fault("drop:byte=4611686018427387904").position, std::uint64_t{1} << 62U);
  EXPECT_FALSE(takes("drop:byte=4611686018427387905"));
  EXPECT_FALSE(takes("drop:byte=-1"));
}

TEST(FaultKeys, AFrameIsCountedFromOne) {
  EXPECT_EQ(fault("drop:frame=1").position, 1U);
  EXPECT_FALSE(takes("drop:frame=0"));
  EXPECT_TRUE(takes("drop:frame=4611686018427387904"));
  EXPECT_FALSE(takes("drop:frame=4611686018427387905"));
}

TEST(FaultKeys, AMomentIsUpToABillionSeconds) {
  EXPECT_EQ(fault("stall:at=0").at, Nanos(0));
  EXPECT_EQ(fault("stall:at=0.000001").at, microseconds(1));
  EXPECT_EQ(fault("stall:at=1000000000").at, seconds(1'000'000'000));
  EXPECT_FALSE(takes("stall:at=1000000000.1"));
}

TEST(FaultKeys, ALengthIsMoreThanNothingAndUpToADay) {
  EXPECT_EQ(fault("delay:p=1,for=0.000001").length, microseconds(1));
  EXPECT_EQ(fault("delay:p=1,for=86400").length, seconds(86'400));
  EXPECT_FALSE(takes("delay:p=1,for=86400.1"));
  EXPECT_FALSE(takes("delay:p=1,for=0"));
  EXPECT_FALSE(takes("delay:p=1,for=0.0000001")) << "less than a microsecond";
}

TEST(FaultKeys, ALengthHasItsKindsDefault) {
  EXPECT_EQ(fault("delay:p=1").length, milliseconds(100));
  EXPECT_EQ(fault("stall:p=1").length, seconds(1));
  EXPECT_EQ(fault("replug:p=1").length, seconds(1));
  EXPECT_EQ(fault("hangup:p=1").length, Nanos(0));
  EXPECT_EQ(fault("drop:p=1").length, Nanos(0));
}

TEST(FaultKeys, NumbersOfUnitsAreUpToABillion) {
  for (const std::string key : {"size", "burst", "times"}) {
    EXPECT_TRUE(takes("drop:p=1," + key + "=1")) << key;
    EXPECT_TRUE(takes("drop:p=1," + key + "=1000000000")) << key;
    EXPECT_FALSE(takes("drop:p=1," + key + "=0")) << key;
    EXPECT_FALSE(takes("drop:p=1," + key + "=1000000001")) << key;
  }
  EXPECT_EQ(fault("drop:p=1,size=2,burst=3,times=4").frame_size, 2U);
  EXPECT_EQ(fault("drop:p=1,size=2,burst=3,times=4").burst, 3U);
  EXPECT_EQ(fault("drop:p=1,size=2,burst=3,times=4").times, 4U);
}

TEST(FaultKeys, OneUnitIsWhatIsStruckWithoutABurst) {
  EXPECT_EQ(again("drop:p=1,burst=1"), "drop:p=1:dir=both");
  EXPECT_EQ(again("drop:p=1,burst=2"), "drop:p=1:dir=both:burst=2");
  EXPECT_EQ(again("drop:p=1,times=1"), "drop:p=1:dir=both:times=1") << "none is no limit";
  EXPECT_EQ(again("drop:p=1,size=1"), "drop:p=1:dir=both:size=1");
}

TEST(FaultKeys, WhatIsKeptOfAFrameMayBeNothing) {
  EXPECT_EQ(fault("truncate:p=1,keep=0").keep, 0U);
  EXPECT_EQ(fault("truncate:p=1,keep=1000000000").keep, 1'000'000'000U);
  EXPECT_FALSE(takes("truncate:p=1,keep=1000000001"));
  EXPECT_FALSE(fault("truncate:p=1").keep.has_value()) << "it is drawn";
  EXPECT_TRUE(takes("truncate:frame=1,keep=1"));
  EXPECT_FALSE(takes("truncate:at=1,keep=1"));
}

TEST(FaultKeys, TheEndOfAFrameIsUpToSixtyFourBytes) {
  std::string hex;
  for (int n = 0; n < 64; ++n) hex += "0a";
  EXPECT_EQ(fault("drop:frame=1,end=" + hex).frame_end.size(), 64U);
  EXPECT_FALSE(takes("drop:frame=1,end=" + hex + "0a"));
  EXPECT_EQ(fault("drop:frame=1,end=00").frame_end, Bytes{0});
  EXPECT_FALSE(takes("drop:frame=1,end="));
  EXPECT_FALSE(takes("drop:frame=1,end=0"));
  EXPECT_FALSE(takes("drop:frame=1,end=0a0"));
  EXPECT_FALSE(takes("drop:frame=1,end=0g"));
}

TEST(FaultKeys, AnEndIsWrittenUnlessItIsTheUsualOne) {
  EXPECT_EQ(again("drop:frame=1,end=0a"), "drop:frame=1:dir=both");
  EXPECT_EQ(again("drop:frame=1,end=0d"), "drop:frame=1:dir=both:end=0d");
}

TEST(FaultKeys, AChangeIsUpToSixtyFourBytesOfWhichEachChanges) {
  std::string hex;
  for (int n = 0; n < 64; ++n) hex += "20";
  EXPECT_EQ(fault("corrupt:p=1,xor=" + hex).change.size(), 64U);
  EXPECT_FALSE(takes("corrupt:p=1,xor=" + hex + "20"));
  EXPECT_TRUE(takes("corrupt:p=1,xor=01"));
  EXPECT_FALSE(takes("corrupt:p=1,xor=0100"));
}

TEST(FaultKeys, ADirectionIsOneOfThreeWords) {
  EXPECT_EQ(fault("drop:p=1,dir=r").dir, LineDir::r);
  EXPECT_EQ(fault("drop:p=1,dir=w").dir, LineDir::w);
  EXPECT_EQ(fault("drop:p=1,dir=both").dir, std::nullopt);
  EXPECT_FALSE(takes("drop:p=1,dir=x"));
}

TEST(FaultKeys, AUnitIsOneOfTwoWords) {
  EXPECT_EQ(fault("drop:p=1,per=byte").unit, Fault::Unit::byte);
  EXPECT_EQ(fault("drop:p=1,per=frame").unit, Fault::Unit::frame);
  EXPECT_EQ(fault("drop:p=1").unit, Fault::Unit::automatic);
  EXPECT_FALSE(takes("drop:p=1,per=bit"));
  EXPECT_FALSE(takes("truncate:p=1,per=byte")) << "it is always of frames";
  EXPECT_FALSE(takes("corrupt:p=1,per=frame")) << "it is always of bytes";
}

TEST(FaultKeys, ABreakByTheClockHasNoDirection) {
  EXPECT_EQ(again("hangup:at=1,dir=r"), "hangup:at=1");
  EXPECT_EQ(again("replug:at=1,dir=w"), "replug:at=1:for=1");
  EXPECT_EQ(again("stall:at=1,dir=r"), "stall:at=1:dir=r:for=1");
  EXPECT_EQ(again("hangup:p=0.5,dir=w"), "hangup:p=0.5:dir=w");
  EXPECT_EQ(fault("hangup:at=1,dir=r").dir, std::nullopt);
  EXPECT_EQ(fault("replug:at=1,dir=r").dir, std::nullopt);
  EXPECT_EQ(fault("hangup:byte=1,dir=r").dir, LineDir::r);
}

TEST(FaultKeys, SeveralLinesAreCountedFromOne) {
  EXPECT_EQ(again("drop\nhangup:at=1"),
            "line 1: fault 'drop': it does not say when; accepted: one of p, byte, frame, at");
  EXPECT_EQ(again("hangup:at=1\n\ndrop"),
            "line 3: fault 'drop': it does not say when; accepted: one of p, byte, frame, at");
}

TEST(FaultKeys, AFileMayHaveOneMebibyte) {
  const test::TempDir folder;
  const std::string path = (folder.path() / "plan").string();
  std::string text = "drop:p=0.5\n";
  text.resize(std::size_t{1} << 20U, '#');
  std::ofstream(path) << text;
  EXPECT_TRUE(load_fault_plan(path, {}).has_value());
  std::ofstream(path, std::ios::app) << '#';
  EXPECT_FALSE(load_fault_plan(path, {}).has_value());
}

TEST(FaultKeys, APlanThatIsNoFileSaysSoOnlyWhereItMayBeOne) {
  EXPECT_EQ(load_fault_plan("drop:q=1", {}).error().message.find("no file of that name"), std::string::npos);
  EXPECT_EQ(load_fault_plan("dorp:p=1", {}).error().message.find("no file of that name"), std::string::npos);
  EXPECT_NE(load_fault_plan("dorp", {}).error().message.find("; and there is no file of that name"),
            std::string::npos);
  EXPECT_EQ(load_fault_plan("", {}).error().message.find("no file of that name"), std::string::npos);
}

}  // namespace
}  // namespace porttape
