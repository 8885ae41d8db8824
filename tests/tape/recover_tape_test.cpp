#include "libport/tape/recover_tape.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <random>
#include <set>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/block.hpp"
#include "libport/tape/event_file.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::Block;
using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSubsetOf;
using testing::SizeIs;

class RecoverTapeTest : public testing::Test {
 protected:
  Result<RecoveredTape> recover(const TapePaths& source) {
    made = literal_tape(dir / ("made" + std::to_string(++count_)));
    return recover_tape(source, made, {.writer = {.sync = false}, .progress = {}});
  }
  // Exchanges a second apart: "ask 1", "answer 1", …
  TapePaths exchanges(int count) {
    MemoryTape tape;
    tape.open(0);
    for (int i = 1; i <= count; ++i)
      tape.write(i * 1'000'000, "ask " + std::to_string(i))
          .read(i * 1'000'000 + 500, "answer " + std::to_string(i));
    tape.close((count + 1) * 1'000'000);
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++count_))), tape,
                            {.device = "d", .driver = "p"});
  }
  static void change(const std::filesystem::path& file, std::size_t at, const std::string& bytes) {
    Bytes all = test::read_file(file);
    ASSERT_LE(at + bytes.size(), all.size());
    std::copy(bytes.begin(), bytes.end(), all.begin() + static_cast<std::ptrdiff_t>(at));
    test::write_file(file, all);
  }
  [[nodiscard]] std::vector<std::string> reads() const { return data_of(made.read); }
  [[nodiscard]] std::vector<std::string> writes() const { return data_of(made.write); }
  static std::vector<std::string> data_of(const std::filesystem::path& file) {
    std::vector<std::string> all;
    for (const Block& block : test::decode_independently(test::read_file(file))) all.push_back(block.data);
    return all;
  }
  [[nodiscard]] std::vector<std::string> gaps() const {
    std::vector<std::string> all;
    for (const std::string& line : test::lines_on(made)) {
      if (line.find(R"("event":"gap")") != std::string::npos) all.push_back(line);
    }
    return all;
  }

  test::TempDir dir;
  TapePaths made;
  int made_count = 0;

 private:
  int count_ = 0;
};

TEST_F(RecoverTapeTest, ASoundTapeIsItself) {
  const TapePaths source = exchanges(20);
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->clean());
  EXPECT_EQ(test::read_file(made.read), test::read_file(source.read));
  EXPECT_EQ(test::read_file(made.write), test::read_file(source.write));
  EXPECT_EQ(test::lines_on(made), test::lines_on(source));
  EXPECT_EQ(header_of(made)->origin->by, "recover");
}

TEST_F(RecoverTapeTest, WithoutEventsAFileThatIsNotThereIsANoteAndLeavesTheTapeWithoutAnEnd) {
  const TapePaths source = exchanges(2);
  std::filesystem::remove(source.events);
  auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(std::string(as_text(test::read_file(made.events))), HasSubstr(R"("event":"end")"));
  std::filesystem::remove(source.write);
  done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->notes, testing::Contains(HasSubstr("is not there: what it held is not known")));
  EXPECT_THAT(std::string(as_text(test::read_file(made.events))),
              testing::Not(HasSubstr(R"("event":"end")")));
}

TEST_F(RecoverTapeTest, ADestroyedHeaderCostsItsBlockAndAGapTellsIt) {
  const TapePaths source = exchanges(20);
  change(source.write, 3 * 17, std::string(12, '\xff'));  // of "ask 4"
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_EQ(done->loss_count, 1U);
  EXPECT_THAT(writes(), SizeIs(19));
  EXPECT_EQ(reads(), data_of(source.read));
  ASSERT_THAT(gaps(), SizeIs(1));
  EXPECT_THAT(gaps()[0], HasSubstr(R"({"t_us":5000000,"event":"gap","bytes":5,"from_us":3000000,"why":)"));
  EXPECT_THAT(gaps()[0], HasSubstr("w at offset 51: 17 bytes of the file are lost"));
}

TEST_F(RecoverTapeTest, AWrongLengthSwallowsNothing) {
  for (const char length : {'\x06', '\x30', '\x7f'}) {
    const TapePaths source = exchanges(20);
    change(source.write, 3 * 17 + 11, std::string(1, length));
    const auto done = recover(source);
    ASSERT_TRUE(done);
    EXPECT_EQ(done->loss_count, 1U) << int{length};
    EXPECT_THAT(writes(), SizeIs(19)) << int{length};
    EXPECT_EQ(writes().at(2), "ask 3");
    EXPECT_EQ(writes().at(3), "ask 5");
  }
}

TEST_F(RecoverTapeTest, ALengthThatIsTooSmallIsMended) {
  const TapePaths source = exchanges(20);
  change(source.write, 3 * 17 + 11, "\x02");
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses, ElementsAre(HasSubstr("a length of 2 is too small by 3")));
  EXPECT_EQ(test::read_file(made.write).size(), std::filesystem::file_size(source.write));
  EXPECT_EQ(writes().at(3), "ask 4");
}

TEST_F(RecoverTapeTest, ALengthBeyondTheEndIsNoTornTail) {
  const TapePaths source = exchanges(20);
  change(source.write, 3 * 17 + 8, std::string("\x40\0\0\0", 4));
  ASSERT_TRUE(recover(source));
  EXPECT_THAT(writes(), SizeIs(19));
}

TEST_F(RecoverTapeTest, AWrongTimeAloneCostsNoBlock) {
  for (const char seconds : {'\0', '\x50'}) {
    const TapePaths source = exchanges(20);
    change(source.write, 3 * 17 + 3, std::string(1, seconds));
    const auto done = recover(source);
    ASSERT_TRUE(done);
    EXPECT_EQ(done->loss_count, 1U);
    EXPECT_EQ(writes(), data_of(source.write));
    const auto blocks = test::decode_independently(test::read_file(made.write));
    EXPECT_EQ(blocks.at(3).us, seconds == 0 ? 3'000'000 : 5'000'000);
    EXPECT_EQ(blocks.at(4).us, 5'000'000);
    ASSERT_THAT(gaps(), SizeIs(1));
    EXPECT_THAT(gaps()[0], HasSubstr(R"("bytes":0,)"));
  }
}

TEST_F(RecoverTapeTest, TimesThatGoBackForGoodKeepTheirBlocks) {
  const TapePaths one = exchanges(5);
  Bytes twice = test::read_file(one.write);
  const Bytes again = twice;
  append(twice, ByteView(again));
  test::write_file(one.write, twice);
  std::filesystem::remove(one.events);
  ASSERT_TRUE(recover(one));
  EXPECT_THAT(writes(), SizeIs(10));
  EXPECT_THAT(gaps(), SizeIs(1));
}

TEST_F(RecoverTapeTest, ATornTailAndADestroyedEndAreLost) {
  const TapePaths torn = exchanges(20);
  std::filesystem::resize_file(torn.read, std::filesystem::file_size(torn.read) - 3);
  auto done = recover(torn);
  ASSERT_TRUE(done);
  EXPECT_THAT(reads(), SizeIs(19));
  EXPECT_THAT(done->losses, ElementsAre(HasSubstr("an unfinished block")));
  const TapePaths garbled = exchanges(20);
  change(garbled.write, 9 * 17 + 9 * 18 + 2, std::string(30, '\xee'));
  done = recover(garbled);
  ASSERT_TRUE(done);
  EXPECT_THAT(writes(), SizeIs(18));
}

TEST_F(RecoverTapeTest, TheVeryBeginIsDestroyed) {
  const TapePaths source = exchanges(20);
  change(source.write, 0, std::string(20, '\xee'));
  change(source.read, 0, std::string(30, '\xee'));
  const auto done = recover(source);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_THAT(writes(), SizeIs(18));
  EXPECT_EQ(writes().front(), "ask 3");
  EXPECT_EQ(reads().front(), "answer 3");
}

TEST_F(RecoverTapeTest, ATapeAsDataIsNoBlocks) {
  const Bytes inner = test::read_file(exchanges(30).read);
  MemoryTape tape;
  for (int i = 0; i < 12; ++i) tape.read(i * 1000, i == 6 ? std::string(as_text(inner)) : "answer");
  const TapePaths source = test::write_tape(literal_tape(dir / "outer"), tape);
  const auto blocks = test::decode_independently(test::read_file(source.read));
  change(source.read, 7 * 18 - 6 + inner.size() + 4, "\xff\xff");  // the header behind it
  ASSERT_TRUE(recover(source));
  ASSERT_THAT(reads(), SizeIs(11));
  EXPECT_EQ(reads().at(6), as_text(inner));
}

TEST_F(RecoverTapeTest, BadLinesOfTheEvents) {
  const TapePaths source = test::write_tape(literal_tape(dir / "t"), MemoryTape()
                                                                         .open(0)
                                                                         .read(5, "a")
                                                                         .event(10, event::Mark{"one"})
                                                                         .event(20, event::Mark{"two"})
                                                                         .event(30, event::Mark{"three"})
                                                                         .event(40, event::Unknown{"snow"})
                                                                         .close(50));
  const std::string good(as_text(test::read_file(source.events)));
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    test::write_file(source.events, as_bytes(text));
    const auto done = recover(source);
    EXPECT_TRUE(done);
    std::vector<std::string> marks;
    for (const std::string& line : test::lines_on(made)) {
      const auto event = decode_event(line);
      const auto* mark = event ? std::get_if<event::Mark>(&event->what) : nullptr;
      if (mark != nullptr) marks.push_back(mark->text.raw() + " " + std::to_string(to_us(event->at)));
    }
    EXPECT_EQ(done ? done->loss_count : 0, 1U) << from;
    return marks;
  };
  EXPECT_THAT(with(R"({"t_us":20,"event":"mark")", R"({"t_us":20,"event":"mar)"),
              ElementsAre("one 10", "three 30"));
  EXPECT_THAT(with(R"("t_us":20,)", R"("t_us":29999,)"), ElementsAre("one 10", "three 30"));
  EXPECT_THAT(with(R"("t_us":20,)", R"("t_us":2,)"), ElementsAre("one 10", "three 30"));
  EXPECT_THAT(with("two", std::string(70'000, 'x')), ElementsAre("one 10", "three 30"));
  EXPECT_THAT(with(R"({"format")", R"({"fromat")"), ElementsAre("one 10", "two 20", "three 30"));
  EXPECT_THAT(with("\n{\"t_us\":0", "\n\0\0\n{\"t_us\":0"), ElementsAre("one 10", "two 20", "three 30"));
  EXPECT_EQ(header_of(made)->device, "");
}

// The gap stands where the events go on, and is from the last one that was sound.
TEST_F(RecoverTapeTest, LostLinesAreAGapBetweenTheEventsAroundThem) {
  const TapePaths source = test::write_tape(literal_tape(dir / "t"), MemoryTape()
                                                                         .open(0)
                                                                         .event(10, event::Mark{"one"})
                                                                         .event(20, event::Mark{"two"})
                                                                         .event(25, event::Mark{"three"})
                                                                         .event(30, event::Mark{"four"})
                                                                         .close(50));
  const std::string good(as_text(test::read_file(source.events)));
  const auto gap_without = [&](const std::vector<std::string>& lost) {
    std::string text = good;
    for (const std::string& mark : lost) text.replace(text.find(mark), mark.size(), "\x01");
    test::write_file(source.events, as_bytes(text));
    EXPECT_TRUE(recover(source));
    EXPECT_THAT(gaps(), SizeIs(1));
    return gaps().empty() ? std::string() : gaps().front();
  };
  EXPECT_THAT(
      gap_without({"two"}),
      testing::StartsWith(R"({"t_us":25,"event":"gap","bytes":0,"from_us":10,"why":"te: line 4 lost: )"));
  EXPECT_THAT(
      gap_without({"two", "three"}),
      testing::StartsWith(
          R"({"t_us":30,"event":"gap","bytes":0,"from_us":10,"why":"te: 2 lines from line 4 on lost: )"));
}

TEST_F(RecoverTapeTest, OfMoreLossesThan64AllAreCountedAndTheFirstAreTold) {
  const TapePaths source = exchanges(700);
  const Bytes good = test::read_file(source.write);
  std::vector<std::size_t> headers{0};
  for (const Block& block : test::decode_independently(good))
    headers.push_back(headers.back() + kHeaderSize + block.data.size());
  for (std::size_t n = 5; n < 5 + 66 * 10; n += 10) change(source.write, headers[n], std::string(12, '\xff'));
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_EQ(done->loss_count, 66U);
  ASSERT_THAT(done->losses, SizeIs(64));
  EXPECT_THAT(done->losses.front(), HasSubstr("at offset " + std::to_string(headers[5])));
  EXPECT_THAT(done->losses.back(), HasSubstr("at offset " + std::to_string(headers[5 + 63 * 10])));
  EXPECT_THAT(gaps(), SizeIs(66));
}

TEST_F(RecoverTapeTest, ProgressGoesOverAllBytesAlsoOverThoseThatAreLost) {
  const TapePaths sound = exchanges(20);
  const TapePaths damaged = exchanges(20);
  change(damaged.write, 3 * 17, std::string(12, '\xff'));
  for (const TapePaths& source : {sound, damaged}) {
    std::vector<std::uint64_t> told;
    const auto done = recover_tape(
        source, literal_tape(dir / ("p" + std::to_string(made_count++))),
        {.writer = {.sync = false}, .progress = [&](std::uint64_t bytes) { told.push_back(bytes); }});
    ASSERT_TRUE(done);
    ASSERT_FALSE(told.empty());
    EXPECT_TRUE(std::ranges::is_sorted(told));
    const std::string events(as_text(test::read_file(source.events)));
    EXPECT_EQ(told.back(), std::filesystem::file_size(source.read) +
                               std::filesystem::file_size(source.write) + events.size() -
                               (events.find('\n') + 1))
        << "the header of the events was read before";
  }
}

TEST_F(RecoverTapeTest, AFileThatIsMissing) {
  TapePaths source = exchanges(3);
  std::filesystem::remove(source.write);
  auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses, ElementsAre(HasSubstr("w is missing: of 3 blocks and 15 bytes")));
  EXPECT_THAT(reads(), SizeIs(3));
  EXPECT_THAT(gaps(), ElementsAre(HasSubstr(R"("bytes":15,"from_us":0,)")));
  source = exchanges(3);
  std::filesystem::remove(source.events);
  done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->clean());
  EXPECT_THAT(done->notes, SizeIs(1));
  std::filesystem::remove(source.read);
  std::filesystem::remove(source.write);
  EXPECT_FALSE(recover(source));
}

TEST_F(RecoverTapeTest, OtherBytesThanTheEndTellsOfAndATapeWithoutAnEnd) {
  const TapePaths changed = exchanges(3);
  change(changed.read, 12, "A");
  const auto done = recover(changed);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses, ElementsAre(HasSubstr("the bytes are not those that the end tells of")));
  const TapePaths killed = exchanges(3);
  const std::string text(as_text(test::read_file(killed.events)));
  test::write_file(killed.events, as_bytes(text.substr(0, text.find(R"({"t_us":4000000,"event":"end")"))));
  ASSERT_TRUE(recover(killed));
  EXPECT_THAT(as_text(test::read_file(made.events)), Not(HasSubstr(R"("event":"end")")));
}

TEST_F(RecoverTapeTest, ATimeThatIsNotWhatTheEndTellsOf) {
  const TapePaths source = exchanges(3);
  change(source.read, 7, std::string(1, '\x01'));  // 1.000500 s, which is 0x1f4 us
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses,
              ElementsAre(HasSubstr("r: the times or lengths of the blocks are not those that the end "
                                    "tells of")));
  EXPECT_THAT(gaps(), SizeIs(1));
}

TEST_F(RecoverTapeTest, ALineThatIsChangedAndStillALine) {
  const TapePaths source = exchanges(3);
  const std::string text(as_text(test::read_file(source.events)));
  change(source.events, text.find("4000000"), "3999999");
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses,
              ElementsAre(HasSubstr("e: a line is not as it was written, by the digest that the end "
                                    "tells; which one is not known")));
}

TEST_F(RecoverTapeTest, AnEndWhoseOwnLineIsChangedIsLost) {
  const TapePaths source = exchanges(3);
  const std::string text(as_text(test::read_file(source.events)));
  change(source.events, text.find("\"line_xxh3"), "\"line_XXh3");
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_THAT(done->losses, ElementsAre(HasSubstr("line 4 lost: the line is not as it was written")));
}

TEST_F(RecoverTapeTest, TheEndVouchesForNoMoreThanTheOthers) {
  const TapePaths source = exchanges(3);
  std::string text(as_text(test::read_file(source.events)));
  const std::size_t end = text.rfind("{\"t_us\":");
  const std::string line = text.substr(end, text.size() - end - 1);
  text.replace(end, std::string::npos, encode_again(line, tape_time_us(4'000'001)));
  for (std::size_t at = 0; (at = text.find(",\"xxh3_all\":")) != std::string::npos;) text.erase(at, 30);
  test::write_file(source.events, test::bytes_of(text));
  const auto done = recover(source);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->clean());
  const std::string made_text(as_text(test::read_file(made.events)));
  EXPECT_THAT(made_text, HasSubstr("\"xxh3\":"));
  EXPECT_THAT(made_text, testing::Not(HasSubstr("xxh3_all")));
  EXPECT_THAT(made_text, testing::Not(HasSubstr("events_xxh3")));
}

TEST_F(RecoverTapeTest, ABlockAtTheLastTimeThatATapeCanHaveIsKept) {
  const TapePaths source = literal_tape(dir / "years");
  test::write_file(source.read, test::block_bytes({{1000, "OK"}, {kMaxBlockTimeUs, "END"}}));
  test::write_file(source.write, test::block_bytes({{500, "AT"}}));
  const auto done = recover(source);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_THAT(reads(), ElementsAre("OK", "END"));
  EXPECT_THAT(writes(), ElementsAre("AT"));
}

TEST_F(RecoverTapeTest, NoiseIsNoTape) {
  std::mt19937 random(1);
  Bytes noise(100'000);
  for (Byte& byte : noise) byte = static_cast<Byte>(random());
  const TapePaths source = literal_tape(dir / "noise");
  test::write_file(source.read, noise);
  const auto done = recover(source);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, Errc::not_a_tape);
  EXPECT_FALSE(std::filesystem::exists(made.read));
}

// The blocks of a file that a range of bytes does not touch, by where they are.
std::vector<Block> outside(const std::vector<Block>& blocks, std::size_t from, std::size_t to) {
  std::vector<Block> kept;
  std::size_t at = 0;
  for (const Block& block : blocks) {
    const std::size_t end = at + kHeaderSize + block.data.size();
    if (end <= from || at >= to) kept.push_back(block);
    at = end;
  }
  return kept;
}

TEST_F(RecoverTapeTest, ARandomRangeDestroyedCostsOnlyWhatItTouches) {
  std::mt19937 random(20260104);
  const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  for (int round = 0; round < 400; ++round) {
    MemoryTape tape;
    std::int64_t now = 0;
    const std::uint32_t count = 20 + choose(100);
    for (std::uint32_t i = 0; i < count; ++i) {
      now += choose(4) == 0 ? 0 : 1 + choose(3'000'000);
      std::string data;
      for (std::uint32_t left = choose(40); left > 0; --left) data += static_cast<char>(choose(256));
      tape.read(now, data);
    }
    const TapePaths source = test::write_tape(literal_tape(dir / ("s" + std::to_string(round))), tape);
    std::filesystem::remove(source.events);
    const Bytes good = test::read_file(source.read);
    const auto blocks = test::decode_independently(good);
    const std::size_t from = choose(static_cast<std::uint32_t>(good.size()));
    const std::size_t size = std::min<std::size_t>(1 + choose(200), good.size() - from);
    std::string damage;
    const std::uint32_t kind = choose(3);
    for (std::size_t i = 0; i < size; ++i)
      damage += kind == 0 ? '\0' : kind == 1 ? '\xff' : static_cast<char>(choose(256));
    change(source.read, from, damage);
    const auto done = recover(source);
    ASSERT_TRUE(done) << done.error().message;
    const auto found = test::decode_independently(test::read_file(made.read));
    const auto kept = outside(blocks, from, from + size);
    std::size_t at = 0;
    for (const Block& block : found) {
      if (at < kept.size() && block == kept[at]) ++at;
    }
    EXPECT_EQ(at, kept.size()) << "round " << round << ", from " << from << ", " << size << " bytes of kind "
                               << kind << ": " << (at < kept.size() ? testing::PrintToString(kept[at]) : "");
  }
}

}  // namespace
}  // namespace porttape
