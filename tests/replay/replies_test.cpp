// Expectations that remember, look ahead and end late, and answers that follow what was asked.

#include "libport/replay/replies.hpp"

#include <memory>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "libport/replay/expectation.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

// Lines: their digits may be any, as many as they like, but their sum is what the last line's was and one
// more. A line is taken whole. `!` alone in a line may be left out.
class SumOfLine : public Expectation {
 public:
  [[nodiscard]] Reach reach() const override { return {.bytes = 16}; }

  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory& memory) const override {
    if (memory.frame.empty()) memory.frame = line_of(recorded);
    if (memory.settled) return rest(recorded, memory, 0);
    if (came.empty() && memory.came.empty() && memory.ended && as_text(memory.frame) == "!\n") {
      memory.settled = true;
      return rest(recorded, memory, 0);
    }
    const std::string_view text = as_text(came);
    const std::size_t size = std::min(text.find('\n'), text.size() - 1) + 1;
    if (came.empty()) return {.differs = memory.ended && !memory.came.empty()};
    memory.came.insert(memory.came.end(), came.begin(), came.begin() + static_cast<std::ptrdiff_t>(size));
    if (memory.came.back() != '\n') return {0, size, false};
    if (sum(memory.came) != sum(memory.frame) + 1) {
      memory.blame = {0, memory.came.size(), "sum"};
      return {0, size, true};
    }
    memory.settled = true;
    return rest(recorded, memory, size);
  }

 private:
  static Bytes line_of(const Stretch& recorded) {
    std::string text(as_text(recorded.bytes));
    text += as_text(recorded.ahead);
    text.resize(std::min(text.find('\n') + 1, text.size()));
    return Bytes(text.begin(), text.end());
  }
  static int sum(const Bytes& line) {
    int sum = 0;
    for (const Byte byte : line) sum += byte >= '0' && byte <= '9' ? byte - '0' : 0;
    return sum;
  }
  static Held rest(const Stretch& recorded, Memory& memory, std::size_t came) {
    const std::size_t left = memory.frame.size() - memory.recorded.size();
    const std::size_t now = std::min(left, recorded.bytes.size());
    const ByteView used = recorded.bytes.first(now);
    memory.recorded.insert(memory.recorded.end(), used.begin(), used.end());
    const bool done = now == left;
    if (done) memory = {};
    return {.recorded = now, .came = came, .goes_on = !done};
  }
};

TEST(RepliesTest, AFrameIsJudgedWholeHoweverTapeAndDriverAreCut) {
  for (std::size_t piece = 1; piece < 8; ++piece) {
    for (std::size_t cut = 1; cut < 9; ++cut) {
      const auto tape =
          MemoryTape().write(0, "a1").write(0, "23").write(1, "4\n").read(5, "ok").write(6, "9\n");
      const SumOfLine rule;
      Rig rig(tape, {}, true, piece, {.expectation = &rule});
      rig.open();
      const std::string_view text = "5510\n";
      for (std::size_t at = 0; at < text.size(); at += cut) rig.write(text.substr(at, cut));
      rig.wait(10);
      EXPECT_EQ(rig.read(), "ok");
      rig.write("55\n");
      EXPECT_EQ(rig.finish(), Verdict::pass);
      EXPECT_EQ(rig.report->from_driver_matched, 8U);
    }
  }
}

TEST(RepliesTest, ADifferenceThatShowsLateIsToldWhereItBegins) {
  const SumOfLine rule;
  for (std::size_t cut = 1; cut < 9; ++cut) {
    Rig rig(MemoryTape().write(0, "1\n").write(1, "2\n3\n"), {}, true, 1, {.expectation = &rule});
    rig.open();
    const std::string_view text = "2\n77\n";
    for (std::size_t at = 0; at < text.size(); at += cut) rig.write(text.substr(at, cut));
    ASSERT_EQ(rig.mismatches.size(), 1U);
    const Mismatch& mismatch = rig.mismatches.front();
    EXPECT_EQ(mismatch.offset, 2U);
    EXPECT_EQ(mismatch.tape_offset, 2U);
    EXPECT_EQ(as_text(mismatch.got), "77\n");
    EXPECT_EQ(as_text(mismatch.expected), "2\n3\n");
    EXPECT_EQ(as_text(mismatch.before), "2\n");
    EXPECT_EQ(mismatch.why, "sum");
  }
}

TEST(RepliesTest, WhatNeedNotComeIsPassedOverAtTheEndAlone) {
  const SumOfLine rule;
  for (const bool closes : {true, false}) {
    Rig rig(MemoryTape().write(0, "1\n").read(1, "x").write(2, "!\n"), {}, true, 1, {.expectation = &rule});
    rig.open().write("2\n").wait(1'000'000);
    EXPECT_TRUE(rig.engine.first_unsent());
    if (closes) rig.close();
    EXPECT_EQ(rig.finish_unless_ended(), Verdict::pass);
  }
}

TEST(RepliesTest, AFrameThatIsCutOffAtTheEndIsADifference) {
  const SumOfLine rule;
  Rig rig(MemoryTape().write(0, "1\n"), {}, true, 1, {.expectation = &rule});
  rig.open().write("2");
  EXPECT_EQ(rig.finish(), Verdict::data_mismatch);
}

// Answers every read with what was asked last, in angle brackets; keeps back what ends in a dot.
class Echo final : public Replies {
 public:
  void begin() override { asked_.clear(); }
  void asked(const Asked& asked) override {
    EXPECT_EQ(asked.offset, offset_);
    offset_ += asked.recorded.size();
    asked_ += as_text(asked.came);
  }
  Bytes answer(const Read& read) override {
    EXPECT_EQ(read.offset, reads_);
    EXPECT_EQ(read.writes, offset_);
    reads_ += read.bytes.size();
    kept_ += as_text(read.bytes);
    return kept_.ends_with('.') ? Bytes() : rest();
  }
  Bytes rest() override {
    const std::string out = "<" + asked_ + kept_ + ">";
    kept_.clear();
    return Bytes(out.begin(), out.end());
  }
  [[nodiscard]] bool keeps() const override { return !kept_.empty(); }

 private:
  std::string asked_;
  std::string kept_;
  std::uint64_t offset_ = 0;
  std::uint64_t reads_ = 0;
};

class Echoing final : public SumOfLine {
  [[nodiscard]] std::unique_ptr<Replies> replies() const override { return std::make_unique<Echo>(); }
};

TEST(RepliesTest, AnAnswerMayFollowWhatWasAsked) {
  const Echoing rule;
  const auto tape = MemoryTape()
                        .write(0, "1\n")
                        .read(1'000, "ok")
                        .read(9'000, "on")
                        .write(10'000, "3\n")
                        .read(11'000, "end");
  Rig rig(tape, {}, true, 20, {.expectation = &rule});
  rig.open().write("2\n").wait(1'000);
  EXPECT_EQ(rig.read(), "<2\nok>");
  rig.wait(8'000);
  EXPECT_EQ(rig.read(), "<2\non>");
  rig.write_bytewise("1111\n").wait(1'000);
  EXPECT_EQ(rig.read(), "<2\n1111\nend>");
  EXPECT_EQ(rig.deliveries.back().block_ends, (std::vector<std::size_t>{12}));
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(RepliesTest, WhatIsKeptOfAnAnswerComesWithItsLastRead) {
  const Echoing rule;
  const auto tape = MemoryTape()
                        .write(0, "1\n")
                        .read(1'000, "ok.")
                        .read(9'000, "on.")
                        .write(10'000, "3\n")
                        .read(11'000, "e.");
  Rig rig(tape, {}, true, 20, {.expectation = &rule});
  rig.open().write("2\n").wait(8'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "<2\nok.on.>");
  rig.write("4\n").wait(1'000);
  EXPECT_EQ(rig.read(), "<2\n4\ne.>");
}

}  // namespace
}  // namespace porttape::test
