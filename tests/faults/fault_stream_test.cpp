#include "libport/faults/fault_stream.hpp"

#include <algorithm>
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
  for (const LineFault& fault : outcome.faults) made.specs.push_back(fault.spec.raw());
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
  EXPECT_EQ(bytes_of("duplicate:byte=3;duplicate:byte=1", "abcde"), "abbcdde")
      << "in whatever order they stand";
  EXPECT_EQ(made_of("duplicate:frame=1,per=frame", {"a", "b", "\nc\n"}).bytes, "ab\nab\nc\n");
}

TEST(FaultStream, TruncatesFrames) {
  EXPECT_EQ(bytes_of("truncate:frame=2,keep=1", "ab\ncde\nf\n"), "ab\ncf\n");
  EXPECT_EQ(bytes_of("truncate:byte=4", "ab\ncde\nf\n"), "ab\ncf\n");
  EXPECT_EQ(bytes_of("truncate:frame=1,keep=9", "ab\ncd\n"), "ab\ncd\n") << "it is as short as that";
  EXPECT_EQ(bytes_of("truncate:frame=2,size=3,keep=1", "abcdefghi"), "abcdghi");
  EXPECT_EQ(bytes_of("truncate:frame=1,end=0d0d0a,keep=0", "a\r\r\r\nbc"), "bc");
  EXPECT_EQ(made_of("truncate:frame=2,keep=3", {"a\nb", "cdef", "g\nh"}).bytes, "a\nbcdh")
      << "a frame that comes in pieces";
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

TEST(FaultStream, WhatIsToldOfAFaultByTheClockNamesItsMoment) {
  EXPECT_EQ(made_of("drop:at=0", {"abc"}).specs, std::vector<std::string>{"drop:at=0:dir=r"});
}

// Reports and tapes keep a seed, and a later version repeats the run from it.
TEST(FaultStream, ASeedStandsForTheSameFaultsInEveryVersion) {
  const FaultPlan plan = plan_of("drop:p=0.1,dir=both;duplicate:p=0.1,dir=both");
  const auto bytes_of = [&plan](LineDir dir) {
    FaultStream stream(plan, 7, dir, false);
    Made made;
    take(stream, "abcdefghijklmnopqrstuvwxyz", made);
    return made.bytes;
  };
  EXPECT_EQ(bytes_of(LineDir::r), "abcdefghjklmnnopqstuvwxyz");
  EXPECT_EQ(bytes_of(LineDir::w), "abcdefghiklmnoppqrstuvwxyz");
}

// When each byte is due, and in which direction's stream.
std::vector<Nanos> dues(const std::string& plan_text, const std::string& arrival, Nanos after = Nanos(0)) {
  const FaultPlan plan = plan_of(plan_text);
  FaultStream stream(plan, 1, LineDir::r, false);
  std::vector<Nanos> all;
  for (const auto& piece : stream.take(as_bytes(arrival), kZero + after, kZero).pieces)
    all.insert(all.end(), piece.data.size(), piece.due == Instant{} ? Nanos(0) : piece.due - kZero);
  return all;
}

TEST(FaultStream, ADelayedByteIsDueAsLongAfterItCameAsIsSaid) {
  EXPECT_EQ(dues("delay:byte=1,for=2", "abc", seconds(5)),
            (std::vector<Nanos>{Nanos(0), seconds(7), Nanos(0)}));
}

TEST(FaultStream, AStallByTheClockEndsAsLongAfterItsMoment) {
  EXPECT_EQ(dues("stall:at=2,for=3", "ab", seconds(4)), (std::vector<Nanos>{seconds(5), seconds(5)}));
}

TEST(FaultStream, AStallAtAByteEndsAsLongAfterItCame) {
  EXPECT_EQ(dues("stall:byte=1,for=3", "abc", seconds(4)),
            (std::vector<Nanos>{Nanos(0), seconds(7), seconds(7)}));
}

TEST(FaultStream, OfADelayAndAStallTheLaterEndCounts) {
  EXPECT_EQ(dues("stall:byte=0,for=3;delay:byte=0,for=5", "ab"),
            (std::vector<Nanos>{seconds(5), seconds(3)}));
  EXPECT_EQ(dues("delay:byte=0,for=5;stall:byte=0,for=3", "ab"),
            (std::vector<Nanos>{seconds(5), seconds(3)}));
  EXPECT_EQ(dues("stall:byte=0,for=5;stall:byte=1,for=3", "ab"),
            (std::vector<Nanos>{seconds(5), seconds(5)}));
}

TEST(FaultStream, AStallHoldsUntilItsEndAndNoLonger) {
  const FaultPlan plan = plan_of("stall:byte=0,for=3");
  FaultStream stream(plan, 1, LineDir::r, false);
  Made made;
  take(stream, "a", made);
  take(stream, "b", made, kZero + seconds(3) - Nanos(1));
  EXPECT_EQ(made.held, "ab");
  EXPECT_TRUE(stream.take(as_bytes("c"), kZero + seconds(3), kZero).untouched);
}

TEST(FaultStream, AMomentStrikesTheFirstByteThatComesThenOrLater) {
  const FaultPlan plan = plan_of("drop:at=2");
  FaultStream stream(plan, 1, LineDir::r, false);
  Made made;
  take(stream, "a", made, kZero + seconds(2) - Nanos(1));
  take(stream, "bc", made, kZero + seconds(2));
  take(stream, "d", made, kZero + seconds(3));
  EXPECT_EQ(made.bytes, "acd");
}

TEST(FaultStream, AByteAtTheBorderOfTwoArrivalsIsStruck) {
  EXPECT_EQ(made_of("drop:byte=3", {"abc", "def"}).bytes, "abcef");
  EXPECT_EQ(made_of("drop:byte=2", {"abc", "def"}).bytes, "abdef");
  EXPECT_EQ(made_of("drop:byte=1,burst=3", {"abc", "def"}).bytes, "aef");
}

TEST(FaultStream, WhatTheSeedGivesChangesEachByteAndRepeatsAfterSixtyFour) {
  const std::string text(200, 'x');
  const std::string changed = bytes_of("corrupt:byte=0,burst=200", text);
  ASSERT_EQ(changed.size(), text.size());
  for (std::size_t at = 0; at < text.size(); ++at) {
    EXPECT_NE(changed[at], 'x') << at;
    EXPECT_EQ(changed[at], changed[at % 64]) << at;
  }
  EXPECT_NE(changed.substr(0, 32), changed.substr(32, 32));
}

TEST(FaultStream, WhatIsToldOfAChangeHasItsBytesUpToSixtyFour) {
  const auto told = [](const std::string& burst) {
    const std::string spec = made_of("corrupt:byte=0,burst=" + burst, {std::string(100, 'x')}).specs.at(0);
    return spec.size() - spec.find("xor=") - 4;
  };
  EXPECT_EQ(told("1"), 2U);
  EXPECT_EQ(told("3"), 6U);
  EXPECT_EQ(told("64"), 128U);
  EXPECT_EQ(told("65"), 128U);
}

TEST(FaultStream, OfATruncatedFrameNothingToFifteenBytesStay) {
  std::string text;
  for (int n = 0; n < 500; ++n) text += std::string(39, 'x') + "\n";
  const FaultPlan plan = plan_of("truncate:p=1");
  FaultStream stream(plan, 1, LineDir::r, false);
  std::size_t least = 40;
  std::size_t most = 0;
  for (std::size_t at = 0; at < text.size(); at += 40) {
    Made made;
    take(stream, text.substr(at, 40), made);
    least = std::min(least, made.bytes.size());
    most = std::max(most, made.bytes.size());
  }
  EXPECT_EQ(least, 0U);
  EXPECT_EQ(most, 15U);
}

TEST(FaultStream, SixtyFourKibibytesComeTwice) {
  const std::string text(FaultStream::kMostDoubled + 10, 'x');
  EXPECT_EQ(bytes_of("duplicate:byte=0,burst=65536", text).size(), text.size() + 65'536);
  EXPECT_EQ(bytes_of("duplicate:byte=0,burst=65537", text).size(), text.size() + 65'536);
}

TEST(FaultStream, AnEndThatBeginsWithinItselfIsFound) {
  // Of 5 bytes that match, the last 3 are a beginning again.
  EXPECT_EQ(bytes_of("drop:frame=1,per=frame,end=616261626163", "abababacX"), "X");
  EXPECT_EQ(bytes_of("drop:frame=1,per=frame,end=616162", "aaabX"), "X");
  EXPECT_EQ(bytes_of("drop:frame=1,per=frame,end=616261", "abbabaX"), "X");
  EXPECT_EQ(bytes_of("drop:frame=2,per=frame,end=6161", "aaaaX"), "aaX") << "frames do not overlap";
}

TEST(FaultStream, FramesOfASizeAreCountedFromTheBeginning) {
  EXPECT_EQ(bytes_of("drop:frame=1,per=frame,size=1", "abc"), "bc");
  EXPECT_EQ(bytes_of("drop:frame=2,per=frame,size=3", "abcdefgh"), "abcgh");
  EXPECT_EQ(bytes_of("drop:frame=1,per=frame,size=3,burst=2", "abcdefgh"), "gh");
}

TEST(FaultStream, EachDirectionIsStruckByItself) {
  const FaultPlan plan = *parse_fault_plan("drop:p=0.5", {});
  FaultStream to_driver(plan, 1, LineDir::r, false);
  FaultStream to_device(plan, 1, LineDir::w, false);
  const std::string text = "abcdefghijklmnopqrstuvwxyz";
  Made one;
  Made other;
  take(to_driver, text, one);
  take(to_device, text, other);
  EXPECT_NE(one.bytes, other.bytes);
}

TEST(FaultStream, TwoFaultsOfAPlanStrikeAtPlacesOfTheirOwn) {
  const std::string text(200, 'x');
  const std::string dropped = bytes_of("drop:p=0.5", text);
  const std::string doubled = bytes_of("drop:p=0;duplicate:p=0.5", text);
  EXPECT_NE(text.size() - dropped.size(), doubled.size() - text.size());
}

TEST(FaultStream, FaultsAreToldInTheOrderOfTheirBytes) {
  const Made made = made_of("corrupt:byte=2,xor=20;drop:byte=1", {"abc"});
  ASSERT_EQ(made.specs.size(), 2U);
  EXPECT_EQ(made.specs[0], "drop:byte=1:dir=r");
  EXPECT_EQ(made.specs[1], "corrupt:byte=2:dir=r:xor=20");
}

TEST(FaultStream, TheFirstBreakOfSeveralCounts) {
  const FaultPlan plan = plan_of("hangup:byte=3;replug:byte=1");
  FaultStream stream(plan, 1, LineDir::r, false);
  const FaultStream::Outcome outcome = stream.take(as_bytes("abcde"), kZero, kZero);
  ASSERT_NE(outcome.broken, nullptr);
  EXPECT_EQ(outcome.broken->kind, Fault::Kind::replug);
  ASSERT_EQ(outcome.faults.size(), 1U);
  EXPECT_EQ(outcome.faults[0].offset, 1U);
}

}  // namespace
}  // namespace porttape
