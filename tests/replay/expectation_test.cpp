// What of a write may vary: rules made here, given to the matcher and to the engine.

#include "libport/replay/expectation.hpp"

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "libport/replay/matcher.hpp"
#include "libport/replay/replay_clock.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

// Bytes `from` up to `to` of each block may be anything.
class AnyBytes final : public Expectation {
 public:
  AnyBytes(std::uint32_t from, std::uint32_t to) : from_(from), to_(to) {}

  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory&) const override {
    const std::uint32_t at = recorded.in_block;
    const bool free = at >= from_ && at < to_;
    const std::uint32_t turn = free ? to_ : at < from_ ? from_ : ~std::uint32_t{0};
    const ByteView part = recorded.bytes.first(std::min<std::size_t>(recorded.bytes.size(), turn - at));
    const std::size_t size = std::min(part.size(), came.size());
    return free ? Held{size, size, false} : exactly(part, came);
  }

 private:
  std::uint32_t from_;
  std::uint32_t to_;
};

// A run of digits stands for any other one, however long.
class AnyNumber final : public Expectation {
 public:
  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory&) const override {
    const bool digit = is_digit(recorded.bytes.front());
    if (came.empty()) {  // the end of the field, where the tape has nothing behind it
      const bool alone = std::ranges::all_of(recorded.bytes, is_digit);
      return {alone ? recorded.bytes.size() : 0, 0, false};
    }
    if (digit && is_digit(came.front())) return {0, 1, false};
    if (digit) return {1, 0, false};
    return exactly(recorded.bytes.first(1), came);
  }

 private:
  static bool is_digit(Byte byte) { return std::isdigit(byte) != 0; }
};

// The same for the run of digits behind `T=` alone.
class NumberOfT final : public Expectation {
 public:
  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory& memory) const override {
    std::string_view before = as_text(recorded.before);
    while (!before.empty() && std::isdigit(static_cast<unsigned char>(before.back())) != 0)
      before.remove_suffix(1);
    if (before.ends_with("T=")) return number_.hold(recorded, came, memory);
    return came.empty() ? Held{} : exactly(recorded.bytes.first(1), came);
  }

 private:
  AnyNumber number_;
};

struct Written {
  std::uint64_t position = 0;
  std::size_t used = 0;
  bool differs = false;
  friend bool operator==(const Written&, const Written&) = default;
};

// Writes `text` in parts of `cut` bytes against a tape in pieces of `piece` bytes.
Written write(const MemoryTape& tape, const Expectation& rule, std::string_view text, std::size_t piece,
              std::size_t cut) {
  MemorySource source(tape, MemorySource::Select::writes_only, piece);
  Budget budget;
  const ReplayClock clock(1);
  Matcher matcher(source, budget, clock, Micros{500}, &rule);
  matcher.rewind();
  Written written;
  while (written.used < text.size()) {
    const auto step = matcher.write(Instant{}, as_bytes(text.substr(written.used, cut)));
    written.used += step.used;
    written.differs = step.outcome == Matcher::Outcome::differs;
    if (written.differs) break;
  }
  written.position = matcher.position();
  return written;
}

TEST(ExpectationTest, BytesOfABlockMayBeAnythingHoweverBothSidesAreCut) {
  const auto tape = MemoryTape().write(1, "GET 1234 now").write(2, "SET 9999 end");
  const AnyBytes rule(4, 8);
  for (std::size_t piece = 1; piece < 13; ++piece) {
    for (std::size_t cut = 1; cut < 25; ++cut) {
      EXPECT_EQ(write(tape, rule, "GET abcd nowSET 1234 end", piece, cut), (Written{24, 24, false}));
      EXPECT_EQ(write(tape, rule, "GET abcd nowSET 1234 and", piece, cut), (Written{21, 21, true}));
    }
  }
}

TEST(ExpectationTest, AFieldMayBeLongerOrShorterHoweverBothSidesAreCut) {
  const auto tape = MemoryTape().write(1, "T=123;Q").write(2, "T=4;Q");
  const AnyNumber rule;
  for (std::size_t piece = 1; piece < 8; ++piece) {
    for (std::size_t cut = 1; cut < 17; ++cut) {
      EXPECT_EQ(write(tape, rule, "T=9;QT=1700000;Q", piece, cut), (Written{12, 16, false}));
      EXPECT_EQ(write(tape, rule, "T=9;QT=17;R", piece, cut), (Written{11, 10, true}));
    }
  }
}

TEST(ExpectationTest, UnderLookupEachBlockOfARequestMayVary) {
  const auto tape = MemoryTape()
                        .write(0, "aXb")
                        .write(100, "cYd")
                        .read(200, "1")
                        .write(300, "aPb")
                        .write(400, "cQd")
                        .read(500, "2");
  const AnyBytes rule(1, 2);
  Rig rig(tape, {.on_mismatch = OnMismatch::fail, .match = Match::lookup}, true, 100, {.expectation = &rule});
  rig.open();
  EXPECT_EQ(rig.write("aMbcNd").wait(1'000).read(), "1");
  EXPECT_EQ(rig.write("aXbcYd").wait(1'000).read(), "2");
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->requests, 1U);
}

TEST(ExpectationTest, TheEngineAnswersAWriteThatVariesAsItMay) {
  const auto tape =
      MemoryTape().write(0, "T=123;").read(1'000, "ok").write(2'000, "T=124;").read(3'000, "on");
  const AnyNumber rule;
  Rig rig(tape, {}, true, 2, {.expectation = &rule});
  rig.open().write("T=5;").wait(1'000);
  EXPECT_EQ(rig.read(), "ok");
  rig.write_bytewise("T=77777;").wait(1'000);
  EXPECT_EQ(rig.read(), "on");
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->from_driver_bytes, 12U);
  EXPECT_EQ(rig.report->from_driver_matched, 12U);  // of the tape's
}

TEST(ExpectationTest, ARuleMayGoByWhatTheBlockHasBeforeAStretch) {
  const auto tape = MemoryTape().write(1, "12 T=123 4").write(2, "3");
  const NumberOfT rule;
  for (std::size_t cut = 1; cut < 13; ++cut) {
    EXPECT_EQ(write(tape, rule, "12 T=77777 43", 20, cut), (Written{11, 13, false}));
    EXPECT_EQ(write(tape, rule, "12 T=77777 5", 20, cut), (Written{9, 11, true}));
    EXPECT_EQ(write(tape, rule, "13 T=77777 4", 20, cut), (Written{1, 1, true}));
  }
}

// The field's end cannot be seen in its bytes: the answer comes at its time, once the driver pauses.
TEST(ExpectationTest, APauseEndsAFieldThatEndsAWrite) {
  const auto tape = MemoryTape().write(0, "T=123").read(2'000, "ok").write(3'000, "T=124").read(3'100, "on");
  const AnyNumber rule;
  for (const std::size_t piece : {std::size_t{1}, std::size_t{4}, std::size_t{5}}) {
    Rig rig(tape, {}, true, piece, {.expectation = &rule});
    rig.open().write("T=123");
    EXPECT_EQ(rig.deadline_us(), 500);
    rig.wait(2'000);
    EXPECT_EQ(rig.read(), "ok");
    EXPECT_EQ(rig.deliveries.back().us, 2'000);
    rig.write_bytewise("T=77777").wait(499);
    EXPECT_EQ(rig.read(), "");
    rig.wait(1);
    EXPECT_EQ(rig.read(), "on");
    EXPECT_EQ(rig.finish(), Verdict::pass);
    EXPECT_EQ(rig.report->from_driver_matched, 10U);
  }
}

TEST(ExpectationTest, WhatComesAfterThePauseIsOfTheNextBlock) {
  const auto tape = MemoryTape().write(0, "T=123").write(2'000, "44;").read(3'000, "ok");
  const NumberOfT rule;
  for (const bool served : {true, false}) {
    for (const int after : {499, 500, 501}) {
      Rig rig(tape, {}, true, 20, {.expectation = &rule});
      rig.open().write("T=9");
      if (served) {
        rig.wait(after);
      } else {
        rig.clock(after);
      }
      rig.write("44;").wait(1'000);
      EXPECT_EQ(rig.mismatches.empty(), after >= 500) << after;
      EXPECT_EQ(rig.read(), after >= 500 ? "ok" : "");
    }
  }
}

TEST(ExpectationTest, ARuleMayWaitForWhatFollowsTheFieldOverAPause) {
  const auto tape = MemoryTape().write(0, "T=123;").read(1'000, "ok");
  const AnyNumber rule;
  Rig rig(tape, {}, true, 20, {.expectation = &rule});
  rig.open().write("T=4").wait(10'000).write("5").wait(10'000);
  EXPECT_EQ(rig.deadline_us(), std::nullopt) << "it was asked once";
  rig.write(";").wait(1'000);
  EXPECT_EQ(rig.read(), "ok");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(ExpectationTest, ACloseOrAnEndOfWritingEndsTheFieldToo) {
  const AnyNumber rule;
  Rig closed(MemoryTape().write(0, "T=123"), {}, true, 20, {.expectation = &rule});
  closed.open().write("T=5").close();
  EXPECT_EQ(closed.verdict(), Verdict::pass);

  Rig finished(MemoryTape().write(0, "T=123"), {}, true, 20, {.expectation = &rule});
  finished.open().write("T=5");
  EXPECT_EQ(finished.finish(), Verdict::pass);

  Rig ended(MemoryTape().write(0, "T=123").read(0, "ok"), {}, true, 20, {.expectation = &rule});
  ended.open().write("T=5");
  EXPECT_EQ(ended.read(), "");
  ended.end_writing();
  EXPECT_EQ(ended.read(), "ok");
}

TEST(ExpectationTest, WhatMayNotVaryIsAMismatchAtItsPlace) {
  const auto tape = MemoryTape().write(0, "T=123;Q").read(1'000, "ok");
  const AnyNumber rule;
  Rig rig(tape, {}, true, 3, {.expectation = &rule});
  rig.open().write("T=5;R");
  ASSERT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.mismatches.front().offset, 4U);
  EXPECT_EQ(rig.mismatches.front().tape_offset, 6U);
  EXPECT_EQ(as_text(rig.mismatches.front().expected), "Q");
  EXPECT_EQ(as_text(rig.mismatches.front().got), "R");
}

TEST(ExpectationTest, ARuleThatUsesNothingUpIsADifference) {
  class Nothing final : public Expectation {
    [[nodiscard]] Held hold(const Stretch&, ByteView, Memory&) const override { return {}; }
  };
  const auto tape = MemoryTape().write(1, "ab");
  EXPECT_EQ(write(tape, Nothing(), "ab", 2, 2), (Written{0, 0, true}));
}

TEST(ExpectationTest, WhatADeviceAnswersMayVaryTheSameWay) {
  const AnyNumber rule;
  for (const std::string_view letter : {"T", "U"}) {
    Rig rig(MemoryTape().write(0, "ask").read(1'000, "T=123;").write(2'000, "end"),
            {.writer = Writer::device, .on_mismatch = OnMismatch::fail}, true, 20, {.expectation = &rule});
    rig.open().write(std::string(letter) + "=56789;").wait(1'000'000);
    EXPECT_EQ(rig.verdict(), letter == "T" ? Verdict::pass : Verdict::data_mismatch);
    EXPECT_EQ(rig.read(), letter == "T" ? "askend" : "ask");
  }
}

TEST(ExpectationTest, WithoutOneNothingMayVary) {
  Rig rig(MemoryTape().write(0, "T=123;").read(1'000, "ok"));
  rig.open().write("T=124;");
  ASSERT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.mismatches.front().offset, 4U);
}

}  // namespace
}  // namespace porttape::test
