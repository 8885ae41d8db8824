#include "libport/faults/fault_stream.hpp"

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr Instant kZero{seconds(1000)};

FaultPlan plan_of(const std::string& text) {
  const Result<FaultPlan> plan = parse_fault_plan(text, LineDir::r);
  EXPECT_TRUE(plan.has_value()) << (plan ? "" : plan.error().message);
  return plan ? *plan : FaultPlan{};
}

// What a stream makes of bytes that come all in one moment: all pieces, and with each fault its plan.
struct Made {
  std::string bytes;
  std::string held;  // of them, those that are due later
  std::vector<std::string> specs;
  bool broken = false;
  friend bool operator==(const Made&, const Made&) = default;
};

void take(FaultStream& stream, std::string_view arrival, Made& made, Instant now = kZero) {
  const FaultStream::Outcome outcome = stream.take(as_bytes(arrival), now, kZero);
  if (outcome.untouched) made.bytes += arrival;
  for (const auto& piece : outcome.pieces) {
    made.bytes += as_text(piece.data);
    if (piece.due > now) made.held += as_text(piece.data);
  }
  for (const LineFault& fault : outcome.faults) made.specs.push_back(fault.spec);
  made.broken = made.broken || outcome.broken != nullptr;
}

Made made_of(const std::string& plan_text, const std::vector<std::string>& arrivals, std::uint64_t seed = 1,
             bool datagrams = false) {
  const FaultPlan plan = plan_of(plan_text);
  FaultStream stream(plan, seed, LineDir::r, datagrams);
  Made made;
  for (const std::string& arrival : arrivals) {
    if (!made.broken) take(stream, arrival, made);
  }
  return made;
}

std::string bytes_of(const std::string& plan, const std::string& text) { return made_of(plan, {text}).bytes; }

TEST(FaultStream, DropsBytesAtTheirPlace) {
  EXPECT_EQ(bytes_of("drop:byte=2", "abcdef"), "abdef");
  EXPECT_EQ(bytes_of("drop:byte=2,burst=3", "abcdef"), "abf");
  EXPECT_EQ(bytes_of("drop:byte=1,per=frame", "ab\ncd\n"), "acd\n");
  EXPECT_EQ(bytes_of("drop:frame=2,per=frame", "ab\ncd\nef\n"), "ab\nef\n");
  EXPECT_EQ(bytes_of("drop:frame=2", "ab\ncd\n"), "ab\nd\n");
  EXPECT_EQ(bytes_of("drop:at=0", "abc"), "bc");
}

TEST(FaultStream, OfTheOtherDirectionItKnowsNothing) {
  const FaultPlan plan = plan_of("drop:p=1,dir=w");
  FaultStream stream(plan, 1, LineDir::r, false);
  EXPECT_TRUE(stream.take(as_bytes("abc"), kZero, kZero).untouched);
}

TEST(FaultStream, CorruptsBytesToOthers) { EXPECT_EQ(bytes_of("corrupt:byte=1,xor=20", "abc"), "aBc"); }

TEST(FaultStream, DoublesBytesAndFrames) {
  EXPECT_EQ(bytes_of("duplicate:byte=1", "abc"), "abbc");
  EXPECT_EQ(bytes_of("duplicate:byte=0,burst=2", "abc"), "ababc");
  EXPECT_EQ(made_of("duplicate:frame=1,per=frame", {"a", "b", "\nc\n"}).bytes, "ab\nab\nc\n");
}

TEST(FaultStream, TruncatesFrames) {
  EXPECT_EQ(bytes_of("truncate:frame=2,keep=1", "ab\ncde\nf\n"), "ab\ncf\n");
  EXPECT_EQ(bytes_of("truncate:byte=4", "ab\ncde\nf\n"), "ab\ncf\n");
  EXPECT_EQ(bytes_of("truncate:frame=1,keep=9", "ab\ncd\n"), "ab\ncd\n") << "it is as short as that";
  EXPECT_EQ(bytes_of("truncate:frame=2,size=3,keep=1", "abcdefghi"), "abcdghi");
  EXPECT_EQ(bytes_of("truncate:frame=1,end=0d0d0a,keep=0", "a\r\r\r\nbc"), "bc");
}

TEST(FaultStream, ADelayHoldsItsBytesAndAStallAllThatFollow) {
  EXPECT_EQ(made_of("delay:byte=1,for=1", {"abc"}).held, "b");
  EXPECT_EQ(made_of("stall:byte=1,for=1", {"abc", "de"}).held, "bcde");
  const FaultPlan plan = plan_of("stall:at=2,for=3");
  FaultStream stream(plan, 1, LineDir::r, false);
  Made made;
  take(stream, "a", made, kZero + seconds(1));
  take(stream, "b", made, kZero + seconds(4));
  take(stream, "c", made, kZero + milliseconds(4500));
  take(stream, "d", made, kZero + seconds(6));
  EXPECT_EQ(made.bytes, "abcd");
  EXPECT_EQ(made.held, "bc");
  EXPECT_EQ(stream.take(as_bytes("e"), kZero + seconds(7), kZero).untouched, true);
}

TEST(FaultStream, AHangUpEndsTheLineAtItsByte) {
  const Made made = made_of("hangup:byte=2", {"abcd", "ef"});
  EXPECT_EQ(made.bytes, "ab");
  EXPECT_TRUE(made.broken);
}

// What is lost behind a break is of no stream, however much of it had come.
TEST(FaultStream, AfterABreakTheStreamGoesOnBehindItsByte) {
  const FaultPlan plan = plan_of("hangup:byte=2;drop:byte=4");
  for (const std::string arrival : {"abc", "abcd", "abcdefghijk"}) {
    FaultStream stream(plan, 1, LineDir::r, false);
    Made made;
    take(stream, arrival, made);
    take(stream, "xyz", made);
    EXPECT_EQ(made.bytes, "abxz") << arrival;
  }
}

TEST(FaultStream, TimesIsALimit) {
  EXPECT_EQ(bytes_of("drop:p=1,times=2", "abcd"), "cd");
  EXPECT_EQ(bytes_of("drop:p=1,times=2,burst=2", "abcdef"), "ef");
}

TEST(FaultStream, InDatagramsAFrameIsOne) {
  EXPECT_EQ(made_of("drop:frame=2", {"ab", "cd", "ef"}, 1, true).bytes, "abef");
  EXPECT_EQ(made_of("drop:p=1,per=byte,times=1", {"ab", "cd"}, 1, true).bytes, "bcd");
  EXPECT_EQ(made_of("truncate:frame=1,keep=1", {"ab", "cd"}, 1, true).bytes, "acd");
  const FaultPlan plan = plan_of("duplicate:frame=1;delay:byte=1,for=1,per=byte");
  FaultStream stream(plan, 1, LineDir::r, true);
  const FaultStream::Outcome outcome = stream.take(as_bytes("abc"), kZero, kZero);
  ASSERT_EQ(outcome.pieces.size(), 2U) << "two datagrams";
  EXPECT_EQ(as_text(outcome.pieces[0].data), "abc");
  EXPECT_EQ(as_text(outcome.pieces[1].data), "abc");
}

TEST(FaultStream, AProbabilityOfZeroDoesNothing) {
  for (const char* const kind : {"drop", "corrupt", "duplicate", "delay", "stall", "truncate", "hangup"}) {
    const FaultPlan plan = plan_of(std::string(kind) + ":p=0");
    FaultStream stream(plan, 1, LineDir::r, false);
    EXPECT_TRUE(stream.take(as_bytes("abc\n"), kZero, kZero).untouched) << kind;
  }
}

TEST(FaultStream, AProbabilityIsKept) {
  const std::string text(100'000, 'x');
  const std::size_t left = made_of("drop:p=0.01", {text}, 7).bytes.size();
  EXPECT_NEAR(static_cast<double>(text.size() - left), 1000, 150);
  EXPECT_EQ(made_of("drop:p=1", {text}).bytes, "");
}

std::string random_text(std::mt19937& random, std::size_t size) {
  std::string text;
  for (std::size_t n = 0; n < size; ++n) text += "ab\r\n$*"[random() % 6];
  return text;
}

std::vector<std::string> cut(std::mt19937& random, const std::string& text) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t size = std::min<std::size_t>(1 + random() % 40, text.size() - at);
    parts.push_back(text.substr(at, size));
    at += size;
  }
  return parts;
}

constexpr const char* kPlans[] = {
    "drop:p=0.05",
    "drop:p=0.1,per=frame",
    "drop:p=0.02,burst=5",
    "corrupt:p=0.05",
    "corrupt:p=0.01,burst=70",
    "duplicate:p=0.05,burst=3",
    "duplicate:p=0.2,per=frame,end=0d0a",
    "delay:p=0.05,for=1",
    "stall:p=0.001,for=1,times=1",
    "truncate:p=0.2",
    "truncate:p=0.1,size=7",
    "drop:p=0.05;corrupt:p=0.05;duplicate:p=0.05;truncate:p=0.05;delay:p=0.01",
};

// However the bytes are cut into arrivals.
TEST(FaultStream, TheSameSeedMakesTheSameFaults) {
  std::mt19937 random(5);
  for (const char* const plan : kPlans) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      const std::string text = random_text(random, 600);
      const Made whole = made_of(plan, {text}, seed);
      EXPECT_EQ(made_of(plan, cut(random, text), seed), whole) << plan << ", seed " << seed;
    }
  }
}

TEST(FaultStream, AnotherSeedMakesOthers) {
  std::mt19937 random(5);
  const std::string text = random_text(random, 2000);
  for (const char* const plan : kPlans) EXPECT_NE(made_of(plan, {text}, 1), made_of(plan, {text}, 2)) << plan;
}

// The plans of what was done are, together, what was done.
TEST(FaultStream, WhatIsToldOfAFaultMakesItAgain) {
  std::mt19937 random(5);
  for (const char* const plan : kPlans) {
    const std::string text = random_text(random, 600);
    const Made made = made_of(plan, {text}, 3);
    std::string told = "drop:p=0";
    for (const std::string& spec : made.specs) told += ";" + spec;
    const Made again = made_of(told, cut(random, text), 99);
    EXPECT_EQ(again.bytes, made.bytes) << plan;
    EXPECT_EQ(again.held, made.held) << plan;
  }
}

}  // namespace
}  // namespace porttape
