#include "libport/tape/tape_reader.hpp"

#include <fcntl.h>
#include <random>
#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tape/block_file.hpp"
#include "libport/tape/tape_lock.hpp"
#include "tests/support/failing_source.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::Block;
using test::TempDir;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::string_view kFutureHeader =
    "{\"format\":\"porttape-events\",\"version\":1,\"device\":\"d\",\"future\":[1]}\n";

TapeReader reader_on(const Bytes& read, const Bytes& write,
                     const std::optional<std::string>& events = std::nullopt,
                     TapeReader::Select select = TapeReader::Select::merged) {
  TapeSources sources{test::memory("t.logr", read), test::memory("t.logw", write), nullptr};
  if (events) sources.events = test::memory("t.loge", test::bytes_of(*events));
  auto reader = TapeReader::from_sources(std::move(sources), select);
  if (!reader) throw std::runtime_error(reader.error().message);
  return std::move(*reader);
}

TEST(TapeReader, MergesByTimeAndOnATieEventsThenWritesThenReads) {
  const Bytes read = test::block_bytes({{10, "r1"}, {20, "r2"}, {20, "r3"}, {40, "r4"}});
  const Bytes write = test::block_bytes({{20, "w1"}, {20, "w2"}, {30, "w3"}, {50, "w4"}});
  const std::string events = std::string(kFutureHeader) + R"({"t_us":0,"event":"open"}
{"t_us":20,"event":"mark","text":"x"}
{"t_us":60,"event":"close"}
)";
  TapeReader reader = reader_on(read, write, events);
  const auto all = test::read_all(reader);
  EXPECT_THAT(all, ElementsAre("open 0", "r 10 r1", "mark 20", "w 20 w1", "w 20 w2", "r 20 r2", "r 20 r3",
                               "w 30 w3", "r 40 r4", "w 50 w4", "close 60"));
  EXPECT_TRUE(reader.rewind());
  EXPECT_EQ(test::read_all(reader), all);
}

// The files of a recorded tape, of which the r file has got other bytes.
TapeReader reader_on_changed(const TapeReader::Options& options, const std::string& behind_end = "") {
  const Bytes read = test::block_bytes({{10, "yes"}});
  const Bytes changed = test::block_bytes({{10, "yet"}});
  PayloadCounter told;
  told.begin_block(tape_time_us(10), 3);
  told.add(as_bytes(std::string_view("yes")));
  const std::string events =
      encode(TapeHeader{.device = "d", .driver = "p", .id = "0123"}) +
      encode(tape_time_us(20), event::End{told.totals(), PayloadCounter().totals(), {}}) + behind_end;
  auto reader = TapeReader::from_sources(
      {test::memory("t.logr", changed), nullptr, test::memory("t.loge", test::bytes_of(events))}, options);
  if (!reader) throw std::runtime_error(reader.error().message);
  return std::move(*reader);
}

TEST(TapeReader, WhatItsEndDoesNotTellOfIsDamageOnceAllIsGiven) {
  TapeReader reader = reader_on_changed({});
  for (int round = 0; round < 2; ++round) {
    EXPECT_TRUE(*reader.next());
    EXPECT_FALSE(reader.came_to_end());
    EXPECT_TRUE(*reader.next());
    for (int again = 0; again < 2; ++again) {
      const auto next = reader.next();
      ASSERT_FALSE(next);
      EXPECT_EQ(next.error().code, Errc::damaged_tape);
      EXPECT_THAT(next.error().message, HasSubstr("t.logr is another tape's, or changed: it holds 1 block, 3 "
                                                  "bytes, xxh3 "));
    }
    EXPECT_TRUE(reader.came_to_end());
    EXPECT_TRUE(reader.rewind());
  }
}

TEST(TapeReader, ItsEndIsNotComparedWhereItIsNotAskedForOrNotTheLast) {
  TapeReader unasked = reader_on_changed({.checks_end = false});
  EXPECT_THAT(test::read_all(unasked), ElementsAre("r 10 yet", "end 20"));
  TapeReader goes_on = reader_on_changed({}, "{\"t_us\":30,\"event\":\"close\"}\n");
  EXPECT_THAT(test::read_all(goes_on), ElementsAre("r 10 yet", "end 20", "close 30"));
}

TEST(TapeReader, RecordsCarryOffsetsAndTheEventsLine) {
  TapeReader reader =
      reader_on(test::block_bytes({{1, "abc"}, {2, "de"}}), {},
                std::string(kFutureHeader) + "{\"t_us\":3,\"event\":\"mark\",\"text\":\"hi\"}\n");
  ASSERT_TRUE(reader.next());
  const auto second = reader.next();
  EXPECT_EQ((**second).stream_offset, 3U);
  EXPECT_EQ((**second).file_offset, 15U);
  EXPECT_TRUE((**second).last_piece());
  const auto mark = reader.next();
  EXPECT_EQ((**mark).kind, RecordKind::event);
  EXPECT_EQ((**mark).event_line, R"({"t_us":3,"event":"mark","text":"hi"})");
}

TEST(TapeReader, AGapIsARecordOfItsOwn) {
  const std::string line = R"({"t_us":9,"event":"gap","bytes":512,"from_us":4,"why":"disk full"})";
  TapeReader reader =
      reader_on(test::block_bytes({{3, "a"}, {9, "b"}}), {}, std::string(kFutureHeader) + line + "\n");
  ASSERT_TRUE(reader.next());
  const auto gap = reader.next();
  EXPECT_EQ((**gap).kind, RecordKind::gap);
  EXPECT_EQ((**gap).at, tape_time_us(9));
  EXPECT_EQ(*(**gap).event, Event(event::Gap{512, tape_time_us(4), "disk full"}));
  EXPECT_EQ((**gap).event_line, line);
  EXPECT_EQ((**reader.next()).kind, RecordKind::read);
}

TEST(TapeReader, OrderIsExactForAnyInterleaving) {
  std::mt19937 random(7);
  for (int round = 0; round < 50; ++round) {
    std::vector<Block> read;
    std::vector<Block> write;
    std::vector<std::string> expected;
    std::int64_t us = 0;
    for (int i = 0; i < 300; ++i) {
      us += static_cast<std::int64_t>(1 + random() % 3);
      const bool is_read = random() % 2 == 0;
      const std::string data(random() % 2000, static_cast<char>('a' + i % 26));
      (is_read ? read : write).push_back({us, data});
      expected.push_back((is_read ? "r " : "w ") + std::to_string(us) + " " + data);
    }
    TapeReader reader = reader_on(test::block_bytes(read), test::block_bytes(write));
    ASSERT_EQ(test::read_all(reader), expected);
  }
}

TEST(TapeReader, PiecesOfALargeBlockStayTogether) {
  const std::string big(BlockFile::kBufferSize * 2, 'x');
  TapeReader reader =
      reader_on(test::block_bytes({{5, big}, {5, "y"}}), test::block_bytes({{5, "w"}, {6, "v"}}));
  std::string order;
  std::uint64_t stream = 0;
  for (auto record = reader.next(); *record; record = reader.next()) {
    order += (**record).kind == RecordKind::read ? 'r' : 'w';
    if ((**record).kind == RecordKind::read) {
      EXPECT_EQ((**record).stream_offset, stream);
      stream += (**record).data.size();
    }
  }
  EXPECT_EQ(stream, big.size() + 1);
  EXPECT_THAT(order, testing::MatchesRegex("wrrr+w"));
}

TEST(TapeReader, ASelectionReadsOneDirectionAndNoEvents) {
  const Bytes read = test::block_bytes({{1, "a"}});
  const Bytes write = test::block_bytes({{2, "b"}});
  TapeReader reads = reader_on(read, write, std::string(kFutureHeader), TapeReader::Select::reads_only);
  EXPECT_THAT(test::read_all(reads), ElementsAre("r 1 a"));
  EXPECT_TRUE(reads.has_events());
  TapeReader writes = reader_on(read, write, std::nullopt, TapeReader::Select::writes_only);
  EXPECT_THAT(test::read_all(writes), ElementsAre("w 2 b"));
  EXPECT_FALSE(writes.has_events());
}

TEST(TapeReader, TornTailsAreNotesAndNotErrors) {
  Bytes read = test::block_bytes({{1, "abc"}, {2, "def"}});
  read.pop_back();
  TapeReader reader =
      reader_on(read, test::block_bytes({{3, "w"}}), std::string(kFutureHeader) + "{\"t_us\":1");
  EXPECT_THAT(test::read_all(reader), ElementsAre("r 1 abc", "w 3 w"));
  ASSERT_TRUE(reader.torn_tail());
  EXPECT_EQ(*reader.torn_tail(),
            "t.logr: torn tail at offset 15: the last 14 bytes are an unfinished block and do not count; "
            "t.loge: the "
            "last line (2) is unfinished and does not count");
}

TEST(TapeReader, DamageIsGivenAgainAndAgain) {
  TapeReader reader = reader_on(test::block_bytes({{5, "a"}, {4, "b"}}), {});
  EXPECT_THAT(test::read_all(reader),
              ElementsAre("r 5 a",
                          "error: t.logr is damaged at offset 13: time goes back from 0.000005 s "
                          "to 0.000004 s"));
  EXPECT_EQ(reader.next().error().code, Errc::damaged_tape);
}

TEST(TapeReader, BothLayoutsReadTheSame) {
  const std::vector<Block> read{{10, "r1"}, {2'000'030, "r2"}};
  const std::vector<Block> write{{5, "w1"}, {2'000'000, ""}};
  TapeReader old = reader_on(test::block_bytes(read, true), test::block_bytes(write, true));
  TapeReader current = reader_on(test::block_bytes(read), test::block_bytes(write));
  EXPECT_EQ(test::read_all(old), test::read_all(current));
}

std::string open_error(const TapePaths& paths) {
  const auto reader = TapeReader::open(paths);
  return reader ? "" : reader.error().message;
}

TEST(TapeReader, AMissingFileOfThePairCountsAsEmpty) {
  const TempDir dir;
  test::write_file(dir / "a.logr", test::block_bytes({{1, "x"}}));
  test::write_file(dir / "b.logw", test::block_bytes({{1, "x"}}));
  auto a = TapeReader::open(literal_tape(dir / "a.log"));
  EXPECT_THAT(test::read_all(*a), ElementsAre("r 1 x"));
  auto b = TapeReader::open(literal_tape(dir / "b.log"));
  EXPECT_THAT(test::read_all(*b), ElementsAre("w 1 x"));
  EXPECT_THAT(open_error(literal_tape(dir / "c.log")), HasSubstr("there is neither"));
}

TEST(TapeReader, AnEmptyTapeIsATape) {
  const TempDir dir;
  test::write_file(dir / "a.logr", {});
  test::write_file(dir / "a.loge", {});
  auto reader = TapeReader::open(literal_tape(dir / "a.log"));
  ASSERT_TRUE(reader);
  EXPECT_TRUE(test::read_all(*reader).empty());
  EXPECT_TRUE(reader->has_events());
  EXPECT_FALSE(reader->header());
}

TEST(TapeReader, WhatIsNoRegularFileIsRefusedAtOnce) {
  const TempDir dir;
  std::filesystem::create_directory(dir / "folder.logr");
  ASSERT_EQ(::mkfifo((dir / "fifo.logr").c_str(), 0600), 0);
  std::filesystem::create_symlink("/dev/null", dir / "device.logr");
  EXPECT_THAT(open_error(literal_tape(dir / "folder.log")), HasSubstr("is a folder"));
  EXPECT_THAT(open_error(literal_tape(dir / "fifo.log")), HasSubstr("is a FIFO"));
  EXPECT_THAT(open_error(literal_tape(dir / "device.log")), HasSubstr("is a device"));
  EXPECT_EQ(TapeReader::open(literal_tape(dir / "fifo.log")).error().code, Errc::usage);
}

TEST(TapeReader, ASymlinkIsFollowed) {
  const TempDir dir;
  test::write_file(dir / "real", test::block_bytes({{1, "x"}}));
  std::filesystem::create_symlink("real", dir / "t.logr");
  auto reader = TapeReader::open(literal_tape(dir / "t.log"));
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 1 x"));
}

TEST(TapeReader, OtherFilesAreNotATape) {
  const TempDir dir;
  test::write_file(dir / "t.logr", as_bytes("a log file of some other program\n"));
  EXPECT_EQ(TapeReader::open(literal_tape(dir / "t.log")).error().code, Errc::not_a_tape);
}

class SharedRecording : public testing::Test {
 protected:
  static std::string path(const std::string& name) {
    return std::string(PORTTAPE_SHARED_DIR) + "/recordings/" + name;
  }
  void SetUp() override {
    if (!std::filesystem::exists(path("urg_04lx.logr")))
      GTEST_SKIP() << "there are no recordings in " << PORTTAPE_SHARED_DIR;
  }
};

TEST_F(SharedRecording, OfALaserIsReadWhole) {
  auto reader = TapeReader::open(literal_tape(path("urg_04lx.log")));
  ASSERT_TRUE(reader);
  std::vector<Block> read;
  std::vector<Block> write;
  TapeTime last{};
  for (auto record = reader->next(); *record; record = reader->next()) {
    auto& blocks = (**record).kind == RecordKind::read ? read : write;
    blocks.push_back({to_us((**record).at), std::string(as_text((**record).data))});
    EXPECT_GE((**record).at, last);
    last = (**record).at;
  }
  EXPECT_EQ(read.size(), 3222U);
  EXPECT_EQ(write.size(), 22U);
  EXPECT_EQ(read, test::decode_independently(test::read_file(path("urg_04lx.logr"))));
  EXPECT_EQ(write, test::decode_independently(test::read_file(path("urg_04lx.logw"))));
  EXPECT_FALSE(reader->torn_tail());
}

TEST_F(SharedRecording, InTheOlderLayoutIsReadWhole) {
  auto reader = TapeReader::open(literal_tape(path("legacy64.log")));
  ASSERT_TRUE(reader);
  std::string sent;
  std::string received;
  for (auto record = reader->next(); *record; record = reader->next()) {
    ((**record).kind == RecordKind::read ? received : sent) += as_text((**record).data);
  }
  EXPECT_EQ(sent, received);  // it was made on a loop-back plug
  EXPECT_THAT(sent, testing::StartsWith("Message #1"));
  EXPECT_FALSE(reader->torn_tail());
}

TEST(TapeReader, WhatIsBeingWrittenIsNotComparedWithItsEnd) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  const PayloadCounter none;
  test::write_file(paths.read, test::block_bytes({{10, "yes"}}));
  test::write_file(paths.events,
                   as_bytes(encode(TapeHeader{.device = "d", .driver = "p", .id = "0123"}) +
                            encode(tape_time_us(20), event::End{none.totals(), none.totals(), {}})));
  {
    const UniqueFd recorder(::open(paths.read.c_str(), O_WRONLY | O_CLOEXEC));
    ASSERT_EQ(lock_tape_file(recorder.get(), AT_FDCWD, paths.read), TapeLock::held);
    auto reader = TapeReader::open(paths);
    ASSERT_TRUE(reader);
    EXPECT_THAT(test::read_all(*reader), ElementsAre("r 10 yes", "end 20"));
  }
  auto reader = TapeReader::open(paths);
  ASSERT_TRUE(reader);
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 10 yes", "end 20", HasSubstr("error: ")));
}

// What keeps the r and w files from being read is damage only where the events file says that it is a tape.
TEST(TapeReader, WithoutATapesEventsOtherFilesAreNoTape) {
  const Bytes header = test::bytes_of("{\"format\":\"porttape-events\",\"version\":1}\n");
  const auto code_of = [](std::unique_ptr<ByteSource> events) {
    const TapeSources sources{test::memory("r", test::bytes_of("neither blocks nor anything like them")),
                              nullptr, std::move(events)};
    const auto layout = sources.layout();
    EXPECT_FALSE(layout);
    return layout ? Errc::usage : layout.error().code;
  };
  EXPECT_EQ(code_of(nullptr), Errc::not_a_tape);
  EXPECT_EQ(code_of(test::memory("e", {})), Errc::not_a_tape);
  EXPECT_EQ(code_of(test::memory("e", test::bytes_of("no events\n"))), Errc::not_a_tape);
  EXPECT_EQ(code_of(test::memory("e", header)), Errc::damaged_tape);
  EXPECT_EQ(code_of(test::memory("e", Bytes(header.begin(), header.end() - 1))), Errc::damaged_tape);
  EXPECT_EQ(code_of(std::make_unique<test::FailingSource>(header, -1)), Errc::damaged_tape);
  EXPECT_EQ(code_of(std::make_unique<test::FailingSource>(header, 0)), Errc::not_a_tape)
      << "it cannot be read";
}

}  // namespace
}  // namespace porttape
