// What is waited for behind a mismatch, and for how long.

#include "libport/taped/aftermath.hpp"

#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

class AftermathTest : public testing::Test {
 protected:
  static constexpr Nanos kMoment = std::chrono::microseconds(1);

  AftermathTest() {
    test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}, {10'000, "two\n"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{5'000, "1\n"}, {15'000, "2\n"}}));
  }
  // Of a run that failed with these bytes, where the tape has "one\n".
  void begin(std::string_view got) {
    RunReport report;
    report.mismatch.emplace().got = test::bytes_of(got);
    aftermath = std::make_unique<Aftermath>(
        PortContext{&loop, book.log()}, Aftermath::Tape{literal_tape(dir / "t.log")}, std::move(report),
        Aftermath::Calls{.deliver = [this](ByteView bytes) { answer += as_text(bytes); },
                         .done = [this](RunReport done) { reports.push_back(std::move(done)); }});
  }
  void write(std::string_view text) { aftermath->write(as_bytes(text)); }
  // Whether it is over when `time` has passed.
  bool over_after(Nanos time) {
    return let_pass(loop, clock, time, [this] { return !reports.empty(); });
  }
  [[nodiscard]] const Mismatch& mismatch() const { return *reports.at(0).mismatch; }

  test::TempDir dir;
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  std::string answer;
  std::vector<RunReport> reports;
  std::unique_ptr<Aftermath> aftermath;
};

TEST_F(AftermathTest, EndsOnceTheDriverHasBeenQuiet) {
  begin("x");
  EXPECT_FALSE(over_after(Aftermath::kQuiet - kMoment));
  write("y");
  EXPECT_FALSE(over_after(Aftermath::kQuiet - kMoment));
  EXPECT_TRUE(aftermath->goes_on());
  EXPECT_TRUE(over_after(kMoment));
  EXPECT_FALSE(aftermath->goes_on());
  EXPECT_EQ(as_text(mismatch().came), "xy");
  EXPECT_EQ(as_text(mismatch().got), "xy");
  EXPECT_FALSE(mismatch().answered);
  EXPECT_EQ(answer, "");
}

TEST_F(AftermathTest, AfterAnAnswerTheDriverHasLongerToGoOn) {
  begin("two\n");
  EXPECT_FALSE(over_after(Aftermath::kQuiet));
  EXPECT_EQ(answer, "2\n");
  EXPECT_FALSE(over_after(Aftermath::kAfterAnswer - kMoment));
  EXPECT_TRUE(over_after(kMoment));
  EXPECT_TRUE(mismatch().answered);
  EXPECT_EQ(as_text(mismatch().came), "two\n");
}

TEST_F(AftermathTest, ADriverThatGoesOnAfterItsAnswerIsWaitedForUntilItIsQuiet) {
  begin("two\n");
  EXPECT_FALSE(over_after(Aftermath::kQuiet));
  write("one\n");
  EXPECT_FALSE(over_after(Aftermath::kQuiet - kMoment));
  EXPECT_TRUE(over_after(kMoment));
  EXPECT_EQ(as_text(mismatch().came), "two\none\n");
  EXPECT_EQ(as_text(mismatch().got), "two\n") << "what came before the answer";
  EXPECT_EQ(answer, "2\n") << "only the first request is answered";
}

TEST_F(AftermathTest, EndsASecondAfterTheMismatchThoughTheDriverWritesOn) {
  begin("x");
  const Nanos step = Aftermath::kQuiet - kMoment;
  Nanos left = Aftermath::kLimit;
  for (; left > step; left -= step) {
    EXPECT_FALSE(over_after(step));
    write(".");
  }
  EXPECT_FALSE(over_after(left - kMoment));
  EXPECT_TRUE(over_after(kMoment));
}

TEST_F(AftermathTest, EndsWhereTheDriverHasWrittenEnough) {
  begin("");
  write(std::string(Mismatch::kMostCame - 1, 'z'));
  EXPECT_TRUE(aftermath->goes_on());
  write("z");
  ASSERT_FALSE(aftermath->goes_on());
  EXPECT_EQ(mismatch().came.size(), Mismatch::kMostCame);
}

TEST_F(AftermathTest, OfMoreThanEnoughTheFirstIsKeptAndLessOfItIsShown) {
  begin("");
  write(std::string(Mismatch::kMostCame, 'a') + "z");
  ASSERT_FALSE(aftermath->goes_on());
  EXPECT_EQ(as_text(mismatch().came), std::string(Mismatch::kMostCame, 'a'));
  EXPECT_EQ(as_text(mismatch().got), std::string(Mismatch::kMostShown, 'a'));
}

TEST_F(AftermathTest, EndedAtOnceItTellsOnceAndKeepsNothingMore) {
  begin("x");
  write("y");
  aftermath->finish();
  ASSERT_EQ(reports.size(), 1U);
  write("z");
  aftermath->finish();
  (void)let_pass(loop, clock, 2 * Aftermath::kLimit);
  EXPECT_EQ(reports.size(), 1U);
  EXPECT_EQ(as_text(mismatch().came), "xy");
  EXPECT_EQ(as_text(mismatch().got), "xy");
}

}  // namespace
}  // namespace porttape
