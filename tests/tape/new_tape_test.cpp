#include "libport/tape/new_tape.hpp"

#include <cerrno>
#include <filesystem>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/block.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::Block;
using test::TempDir;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const TapeHeader kNewHeader{"serial:/dev/ttyUSB0", "pty:/tmp/laser"};

NewTape begin_tape(const TapePaths& paths, OnExisting on_existing = OnExisting::refuse) {
  auto tape = NewTape::create(paths, kNewHeader, {.on_existing = on_existing, .sync = false});
  if (!tape) throw std::runtime_error(tape.error().message);
  return std::move(*tape);
}

std::vector<std::string> names_in(const TempDir& dir) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(dir.path()))
    names.push_back(entry.path().filename().string());
  return names;
}

TEST(NewTape, EqualTimesAndEmptyBlocksStayAndItAppearsByFinish) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  NewTape tape = begin_tape(paths);
  EXPECT_TRUE(tape.event(tape_time_us(0), event::Open{}));
  EXPECT_TRUE(tape.block(Direction::write, tape_time_us(5), as_bytes("ab")));
  EXPECT_TRUE(tape.block(Direction::write, tape_time_us(5), {}));
  EXPECT_TRUE(tape.block(Direction::read, tape_time_us(5), as_bytes("c")));
  EXPECT_THAT(names_in(dir), IsEmpty());
  ASSERT_TRUE(tape.finish(tape_time_us(9)));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.write)),
              ElementsAre(Block{5, "ab"}, Block{5, ""}));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.read)), ElementsAre(Block{5, "c"}));
  auto reader = TapeReader::open(paths);
  ASSERT_TRUE(reader);
  ASSERT_THAT(test::read_all(*reader).back(), HasSubstr("end"));
  EXPECT_FALSE(tape.event(tape_time_us(9), event::Open{}));
}

TEST(NewTape, NothingIsLeftWithoutFinish) {
  const TempDir dir;
  {
    NewTape tape = begin_tape(literal_tape(dir / "t.log"));
    EXPECT_TRUE(tape.block(Direction::read, tape_time_us(1), Bytes(1'000'000, Byte{7})));
  }
  EXPECT_THAT(names_in(dir), IsEmpty());
}

TEST(NewTape, ATimeThatGoesBackIsAnErrorThatStays) {
  const TempDir dir;
  NewTape tape = begin_tape(literal_tape(dir / "t.log"));
  EXPECT_TRUE(tape.block(Direction::read, tape_time_us(2'000'000), as_bytes("a")));
  EXPECT_TRUE(tape.block(Direction::write, tape_time_us(1), as_bytes("a")));
  const auto back = tape.block(Direction::read, tape_time_us(1'999'999), as_bytes("b"));
  ASSERT_FALSE(back);
  EXPECT_THAT(back.error().message, HasSubstr("from 2.000000 s to 1.999999 s"));
  EXPECT_FALSE(tape.block(Direction::read, tape_time_us(3'000'000), as_bytes("c")));
  EXPECT_FALSE(tape.finish(tape_time_us(3'000'000)));
  EXPECT_THAT(names_in(dir), IsEmpty());
}

TEST(NewTape, TimesThatNoHeaderHolds) {
  const TempDir dir;
  for (const std::int64_t us : {std::int64_t{-1}, kMaxBlockTimeUs + 1}) {
    NewTape tape = begin_tape(literal_tape(dir / "t.log"));
    EXPECT_FALSE(tape.block(Direction::read, tape_time_us(us), as_bytes("a")));
  }
  NewTape tape = begin_tape(literal_tape(dir / "t.log"));
  EXPECT_TRUE(tape.block(Direction::read, tape_time_us(kMaxBlockTimeUs), as_bytes("a")));
}

TEST(NewTape, ABlockInPiecesIsOneBlock) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  NewTape tape = begin_tape(paths);
  const std::string piece(100'000, 'x');
  EXPECT_TRUE(tape.begin_block(Direction::read, tape_time_us(1), 300'000));
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(tape.add(as_bytes(piece)));
  ASSERT_TRUE(tape.finish(tape_time_us(1)));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.read)),
              ElementsAre(Block{1, piece + piece + piece}));
}

TEST(NewTape, ABlockHasNeitherMoreNorLessThanItWasBegunWith) {
  const TempDir dir;
  NewTape more = begin_tape(literal_tape(dir / "t.log"));
  EXPECT_TRUE(more.begin_block(Direction::read, tape_time_us(1), 2));
  EXPECT_FALSE(more.add(as_bytes("abc")));
  NewTape less = begin_tape(literal_tape(dir / "u.log"));
  EXPECT_TRUE(less.begin_block(Direction::read, tape_time_us(1), 2));
  EXPECT_TRUE(less.add(as_bytes("a")));
  EXPECT_FALSE(less.finish(std::nullopt));
}

TEST(NewTape, ANameThatIsTakenIsRefusedOrReplaced) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  NewTape first = begin_tape(paths);
  NewTape second = begin_tape(paths);
  EXPECT_TRUE(first.block(Direction::read, tape_time_us(1), as_bytes("first")));
  ASSERT_TRUE(first.finish(std::nullopt));
  const auto taken = second.finish(std::nullopt);
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, Errc::usage);
  EXPECT_THAT(taken.error().message, HasSubstr("has come into being meanwhile"));
  EXPECT_FALSE(NewTape::create(paths, kNewHeader, {}));
  EXPECT_EQ(names_in(dir).size(), 3U);

  NewTape third = begin_tape(paths, OnExisting::overwrite);
  EXPECT_TRUE(third.block(Direction::read, tape_time_us(1), as_bytes("third")));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.read)), ElementsAre(Block{1, "first"}));
  ASSERT_TRUE(third.finish(std::nullopt));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.read)), ElementsAre(Block{1, "third"}));
  EXPECT_EQ(names_in(dir).size(), 3U);
}

TEST(NewTape, UnknownKeysOfHeaderAndEventsStay) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  const std::string header = R"({"format":"porttape-events","version":1,"id":"x","colour":"red"})";
  auto tape = NewTape::create(paths, header, {.sync = false});
  ASSERT_TRUE(tape);
  EXPECT_TRUE(tape->event_line(tape_time_us(7), R"({"t_us":3,"event":"snow","deep":[1,2]})"));
  ASSERT_TRUE(tape->finish(std::nullopt));
  const Bytes events = test::read_file(paths.events);
  EXPECT_EQ(as_text(events), header + "\n" + R"({"t_us":7,"event":"snow","deep":[1,2]})" + "\n");
  EXPECT_FALSE(NewTape::create(literal_tape(dir / "u.log"), R"({"format":"other"})", {}));
}

// A sink that takes so many bytes.
class SmallSink final : public TapeSink {
 public:
  explicit SmallSink(std::size_t room) : room_(room) {}
  Appended append(ByteView head, ByteView body) override {
    const std::size_t size = head.size() + body.size();
    if (size > room_) return {0, ENOSPC};
    room_ -= size;
    return {size, 0};
  }
  int truncate(std::uint64_t) override { return 0; }
  Sync syncer() override {
    return [] { return 0; };
  }
  int close() override { return 0; }

 private:
  std::size_t room_;
};

TEST(NewTape, AFullDiskIsToldAndEndsIt) {
  TapeSinks sinks{std::make_unique<SmallSink>(1'000'000), std::make_unique<SmallSink>(100),
                  std::make_unique<SmallSink>(100'000)};
  auto tape = NewTape::on_sinks(std::move(sinks), kNewHeader);
  ASSERT_TRUE(tape);
  EXPECT_TRUE(tape->block(Direction::read, tape_time_us(1), Bytes(500'000, Byte{1})));
  EXPECT_TRUE(tape->block(Direction::write, tape_time_us(1), Bytes(200, Byte{1})));
  const auto finished = tape->finish(tape_time_us(2));
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().code, Errc::io);
  EXPECT_THAT(finished.error().message, HasSubstr("No space left on device"));
  EXPECT_FALSE(tape->event(tape_time_us(3), event::Open{}));
}

TEST(NewTape, ACopyOfARandomTapeIsThatTape) {
  const TempDir dir;
  std::mt19937 random(20260101);
  for (int round = 0; round < 200; ++round) {
    const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    const test::MemoryTape source = test::random_tape(
        choose, {.sessions = true, .hang_ups = true, .half_closes = true, .gaps = true, .signals = true});
    const TapePaths first = literal_tape(dir / ("a" + std::to_string(round)));
    const TapePaths second = literal_tape(dir / ("b" + std::to_string(round)));
    NewTape tape = begin_tape(first);
    for (const auto& entry : source.entries()) ASSERT_TRUE(test::put(tape, entry));
    ASSERT_TRUE(tape.finish(std::nullopt));
    auto reader = TapeReader::open(first);
    ASSERT_TRUE(reader);
    NewTape copied = begin_tape(second);
    while (const auto record = reader->next()) {
      if (!*record) break;
      ASSERT_TRUE(copied.copy(**record));
    }
    ASSERT_TRUE(copied.finish(std::nullopt));
    EXPECT_EQ(test::read_file(first.read), test::read_file(second.read));
    EXPECT_EQ(test::read_file(first.write), test::read_file(second.write));
    const auto lines = [](const Bytes& bytes) {
      const std::string text(as_text(bytes));
      return text.substr(text.find('\n'));
    };
    EXPECT_EQ(lines(test::read_file(first.events)), lines(test::read_file(second.events)));
  }
}

}  // namespace
}  // namespace porttape
