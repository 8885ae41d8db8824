#include "libport/tape/cut_tape.hpp"

#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event_file.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;

class CutTapeTest : public testing::Test {
 protected:
  Result<CutTape> cut(const CutRange& range, bool rebased = false) {
    made = literal_tape(dir / ("cut" + std::to_string(++cuts)));
    return cut_tape(source, made,
                    {.range = range, .rebased = rebased, .writer = {.sync = false}, .progress = {}});
  }
  [[nodiscard]] std::vector<std::string> kept() const {
    auto reader = TapeReader::open(made);
    return reader ? test::read_all(*reader) : std::vector<std::string>{reader.error().message};
  }
  std::string why(const CutRange& range) {
    const auto done = cut(range);
    EXPECT_FALSE(std::filesystem::exists(made.read));
    return done ? "" : done.error().message;
  }

  test::TempDir dir;
  int cuts = 0;
  TapePaths made;
  TapePaths source = test::write_tape(literal_tape(dir / "t.log"),
                                      MemoryTape()
                                          .open(0)
                                          .event(10, event::Settings{Side::device, {.baud = 9600}, {}})
                                          .write(100, "a")
                                          .read(200, "A")
                                          .event(250, event::Mark{"one"})
                                          .write(300, "b")
                                          .write(300, "bb")
                                          .read(300, "B")
                                          .event(350, event::Unknown{"snow"})
                                          .gap(400, 5, 380)
                                          .event(450, event::Mark{"two"})
                                          .read(500, "")
                                          .close(600),
                                      {.device = "d",
                                       .driver = "p",
                                       .id = "0123",
                                       .zero = TapeZero{"2024-05-06T07:08:09.000000Z", 5'000'000, "boot"}});
};

TEST_F(CutTapeTest, ByTimesWithWhatHeldBefore) {
  const auto done = cut(TimeRange{tape_time_us(200), tape_time_us(400)});
  ASSERT_TRUE(done);
  EXPECT_EQ(done->blocks, 4U);
  EXPECT_EQ(done->events, 2U);
  EXPECT_EQ(to_us(done->from), 200);
  EXPECT_EQ(to_us(done->to), 350);
  EXPECT_THAT(kept(), ElementsAre("open 200", "settings 200", "r 200 A", "mark 250", "w 300 b", "w 300 bb",
                                  "r 300 B", "snow 350", "end 350"));
  EXPECT_THAT(test::carried_on(made), ElementsAre("open 200", "settings 200"));
}

TEST_F(CutTapeTest, RebasedTheZeroAndAGapsBeginMoveToo) {
  ASSERT_TRUE(cut(TimeRange{tape_time_us(390), TapeTime::max()}, true));
  EXPECT_THAT(kept(),
              ElementsAre("open 0", "settings 0", "gap 0", "mark 50", "r 100 ", "close 200", "end 200"));
  EXPECT_THAT(test::lines_on(made).front(), HasSubstr(R"("bytes":5,"from_us":-20,)"));
  const auto header = header_of(made);
  ASSERT_TRUE(header);
  EXPECT_EQ(header->zero, (TapeZero{"2024-05-06T07:08:09.000400Z", 5'000'400, "boot"}));
  EXPECT_NE(header->id, "0123");
  EXPECT_EQ(header->origin, (TapeOrigin{"cut", {{"0123", "t.log"}}, Micros(400)}));
  EXPECT_EQ(header->device, "d");
}

TEST_F(CutTapeTest, ByExchanges) {
  ASSERT_TRUE(cut(ExchangeRange{1, 1}));
  EXPECT_THAT(kept(), ElementsAre("open 100", "settings 100", "w 100 a", "r 200 A", "mark 250", "end 250"));
  ASSERT_TRUE(cut(ExchangeRange{2, 9}));
  EXPECT_THAT(kept()[2], "w 300 b");
  EXPECT_THAT(kept().back(), "end 600");
  EXPECT_THAT(why(ExchangeRange{3, 3}), HasSubstr("it has only 2 exchanges"));
}

TEST_F(CutTapeTest, ByMarks) {
  ASSERT_TRUE(cut(MarkRange{"one", "two"}));
  EXPECT_THAT(kept(), ElementsAre("open 250", "settings 250", "mark 250", "w 300 b", "w 300 bb", "r 300 B",
                                  "snow 350", "gap 400", "mark 450", "end 450"));
  ASSERT_TRUE(cut(MarkRange{{}, "one"}));
  EXPECT_THAT(kept().front(), "open 0");
  EXPECT_THAT(kept().back(), "end 250");
  ASSERT_TRUE(cut(MarkRange{"two", {}}));
  EXPECT_THAT(kept()[2], "mark 450");
  EXPECT_THAT(why(MarkRange{"tow", {}}), HasSubstr("did you mean 'two'?"));
  EXPECT_THAT(why(MarkRange{"two", "one"}), HasSubstr("no mark 'one' behind 'two'"));
  EXPECT_THAT(why(MarkRange{"something", {}}), HasSubstr("its marks are 'one', 'two'"));
}

TEST_F(CutTapeTest, NothingInTheRange) {
  EXPECT_THAT(why(TimeRange{tape_time_us(7'000'000), TapeTime::max()}), HasSubstr("it ends at 0.000600 s"));
}

TEST_F(CutTapeTest, OfATapeDamagedBehindTheRangeThePartHasNoEndAndOfOneInItNothingIsLeft) {
  Bytes bytes = test::read_file(source.read);
  bytes.at(13 + 4) = 0xff;  // the second block's microseconds
  test::write_file(source.read, bytes);
  EXPECT_THAT(why(TimeRange{tape_time_us(100), tape_time_us(400)}), HasSubstr("damaged at offset 13"));
  const auto done = cut(TimeRange{tape_time_us(0), tape_time_us(101)});
  ASSERT_TRUE(done);
  ASSERT_TRUE(done->damage_behind);
  EXPECT_THAT(done->damage_behind->message, HasSubstr("damaged at offset 13"));
  EXPECT_THAT(kept().back(), "w 100 a");
}

TEST_F(CutTapeTest, OfBytesThatAreNotTheRecordedOnesNothingIsLeft) {
  Bytes bytes = test::read_file(source.read);
  bytes.at(12 + 1 + 12) = 'X';  // of the second block
  test::write_file(source.read, bytes);
  const std::string changed = "t.logr is another tape's, or changed: it holds 3 blocks";
  EXPECT_THAT(why(TimeRange{}), HasSubstr(changed));
  EXPECT_THAT(why(TimeRange{tape_time_us(0), tape_time_us(101)}), HasSubstr(changed));
  std::filesystem::remove(source.read);
  EXPECT_THAT(why(TimeRange{tape_time_us(0), tape_time_us(101)}), HasSubstr("t.logr is missing"));
}

TEST_F(CutTapeTest, ATapeWithoutAnEndHasNoneInItsLastPart) {
  Bytes bytes = test::read_file(source.events);
  const std::string text(as_text(bytes));
  test::write_file(source.events, as_bytes(text.substr(0, text.find(R"({"t_us":600,"event":"end")"))));
  ASSERT_TRUE(cut(TimeRange{tape_time_us(400), TapeTime::max()}));
  EXPECT_THAT(kept().back(), "close 600");
  ASSERT_TRUE(cut(TimeRange{tape_time_us(400), tape_time_us(600)}));
  EXPECT_THAT(kept().back(), "end 501");
  std::filesystem::remove(source.events);
  ASSERT_TRUE(cut(TimeRange{tape_time_us(400), TapeTime::max()}));
  EXPECT_THAT(kept(), ElementsAre("r 500 ", "end 501"));
  EXPECT_EQ(header_of(made)->stamped, Stamped::read);
}

TEST_F(CutTapeTest, OfARandomTapeAllIsTheTapeAndTwoPartsAreIt) {
  std::mt19937 random(20260102);
  for (int round = 0; round < 100; ++round) {
    const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    source = test::write_tape(
        literal_tape(dir / ("s" + std::to_string(round))),
        test::random_tape(
            choose,
            {.sessions = true, .hang_ups = true, .half_closes = true, .gaps = true, .signals = true}));
    const std::vector<std::string> all = test::lines_on(source);
    if (all.empty()) continue;
    ASSERT_TRUE(cut(TimeRange{}));
    EXPECT_EQ(test::lines_on(made), all);
    EXPECT_EQ(test::read_file(made.read), test::read_file(source.read));
    const TapeTime where = tape_time_us(choose(900'000));
    std::vector<std::string> parts;
    for (const TimeRange& range : {TimeRange{{}, where}, TimeRange{where, TapeTime::max()}}) {
      if (!cut(range)) continue;
      for (const std::string& line : test::lines_on(made)) parts.push_back(line);
    }
    EXPECT_EQ(parts, all);
  }
}

}  // namespace
}  // namespace porttape
