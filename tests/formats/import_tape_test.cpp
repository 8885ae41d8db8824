#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class ImportTapeTest : public testing::Test {
 protected:
  ImportTape importer(ImportOptions options = {}) {
    return {new_tape(dir / "t"), {.sync = false}, std::move(options), "log.txt"};
  }
  test::TempDir dir;
};

TEST_F(ImportTapeTest, TimesThatGoBackAreCountedAndBecomeThoseBefore) {
  ImportTape tape = importer();
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(100), as_bytes("a")));
  ASSERT_TRUE(tape.block(Direction::write, tape_time_us(50), as_bytes("b")));
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(60), as_bytes("c")));
  const auto made = tape.finish();
  ASSERT_TRUE(made);
  EXPECT_THAT(made->problems, ElementsAre(HasSubstr("2 times go back, first at 50 µs; ")));
  EXPECT_EQ(made->end, tape_time_us(100));
  EXPECT_EQ(made->blocks, 3U);
}

TEST_F(ImportTapeTest, TimesThatGoBackInLinesAreToldWithThese) {
  ImportTape tape = importer();
  tape.at_line(3);
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(100), as_bytes("a")));
  for (std::uint64_t line = 4; line < 12; ++line) {
    tape.at_line(line);
    ASSERT_TRUE(tape.block(Direction::write, tape_time_us(50), as_bytes("b")));
    ASSERT_TRUE(tape.event(tape_time_us(50), event::Mark{"m"}));
  }
  EXPECT_THAT(tape.finish()->problems,
              ElementsAre(HasSubstr("lines 4, 5, 6, 7, 8 and 3 more: the time goes back; ")));
}

TEST_F(ImportTapeTest, LeadIsSilenceBeforeAllAndSwapTurnsTheDirections) {
  ImportTape tape = importer({.swapped = true, .lead = Micros(2'000'000), .bytes_at = {}, .device = {}});
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(7), as_bytes("a")));
  ASSERT_TRUE(tape.event(tape_time_us(8), event::Mark{"m"}));
  const auto made = tape.finish();
  ASSERT_TRUE(made);
  auto reader = TapeReader::open(made->paths);
  const auto first = reader->next();
  EXPECT_EQ((**first).kind, RecordKind::write);
  EXPECT_EQ((**first).at, tape_time_us(2'000'007));
  EXPECT_EQ((**reader->next()).at, tape_time_us(2'000'008));
}

TEST_F(ImportTapeTest, ATimeBeyondAllIsAnErrorWhateverTheLead) {
  ImportTape tape =
      importer({.swapped = false, .lead = Micros(10'000'000'000'000'000), .bytes_at = {}, .device = {}});
  EXPECT_FALSE(tape.block(Direction::read, TapeTime::max(), as_bytes("a")));
}

TEST_F(ImportTapeTest, BytesWithoutTimesComeAtTheLinesSpeed) {
  ImportTape tape = importer({.swapped = false, .lead = {}, .bytes_at = 9600, .device = {}});
  ASSERT_TRUE(tape.block(Direction::read, std::nullopt, as_bytes(std::string(96, 'x'))));
  EXPECT_EQ(tape.latest(), tape_time_us(100'000));
  ASSERT_TRUE(tape.block(Direction::read, std::nullopt, as_bytes(std::string(96, 'x'))));
  EXPECT_EQ(tape.latest(), tape_time_us(200'000));
}

TEST_F(ImportTapeTest, WhatWasGuessedStandsOnTheTape) {
  ImportTape tape = importer();
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(1), as_bytes("a")));
  tape.guessed("directions");
  tape.guessed("directions");
  const auto made = tape.finish();
  ASSERT_TRUE(made);
  EXPECT_THAT(made->guesses, ElementsAre("directions"));
  EXPECT_THAT(test::lines_on(made->paths), testing::Contains(HasSubstr("convert: directions")));
  EXPECT_THAT(test::header_line_of(made->paths),
              HasSubstr(R"("origin":{"by":"convert","tapes":[{"name":"log.txt"}]})"));
}

TEST_F(ImportTapeTest, AnErrorStaysAndNothingAppears) {
  ImportTape tape = importer();
  ASSERT_TRUE(tape.block(Direction::read, tape_time_us(1), as_bytes("a")));
  EXPECT_FALSE(tape.event(tape_time_us(5'000'000'000'000'000), event::Open{}));
  EXPECT_FALSE(tape.block(Direction::read, tape_time_us(3), as_bytes("a")));
  EXPECT_FALSE(tape.finish());
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(dir / "t.logr")));
}

}  // namespace
}  // namespace porttape
