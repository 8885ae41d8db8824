// A tape without a thread to be had, so that all that it does is done when the call returns; and what a
// writer does with batches.

#include <cerrno>
#include <cstdint>
#include <memory>
#include <new>
#include <string>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/disks.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/live_tape.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/taking_sink.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::holds_without;
using testing::ElementsAre;
using testing::HasSubstr;
using LivePhase = LiveTape::Status::Phase;

const std::vector<test::RefusedCall> kNoThreads{{SYS_clone3, EAGAIN}, {SYS_clone, EAGAIN}};

// A file in memory that fails when a test wants it.
struct FaultyFiles {
  std::vector<std::string> appended;
  int calls = 0;
  int error = 0;
};
class FaultySink final : public test::TakingSink {
 public:
  explicit FaultySink(FaultyFiles& files) : files_(files) {}
  Appended append(ByteView head, ByteView body) override {
    ++files_.calls;
    if (files_.error != 0) return {0, files_.error};
    files_.appended.push_back(std::string(as_text(head)) + std::string(as_text(body)));
    return TakingSink::append(head, body);
  }

 private:
  FaultyFiles& files_;
};
TapeSinks faulty_sinks(FaultyFiles& files) {
  return {std::make_unique<FaultySink>(files), std::make_unique<FaultySink>(files),
          std::make_unique<FaultySink>(files)};
}

class LiveTapeAlone : public testing::Test {
 protected:
  LiveTape::Options options() {
    LiveTape::Options made{.paths = paths, .header = {"device", "driver"}, .writer = {.sync = false}};
    made.on_news = [this] { ++news; };
    return made;
  }
  [[nodiscard]] dev_t disk() const {
    struct stat folder {};
    EXPECT_EQ(::stat(dir.path().c_str(), &folder), 0);
    return folder.st_dev;
  }
  [[nodiscard]] std::size_t read_size() const { return test::read_file(paths.read).size(); }

  test::TempDir dir;
  const TapePaths paths = literal_tape(dir / "t");
  std::shared_ptr<Disks> disks = std::make_shared<Disks>();
  Workers workers;
  int news = 0;
};

TEST_F(LiveTapeAlone, IsMadeAndWrittenByItsCaller) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    LiveTape tape(workers, disks, options());
    EXPECT_EQ(tape.status().phase, LivePhase::queued);
    EXPECT_TRUE(tape.queued());
    EXPECT_EQ(tape.status().paths, paths);
    EXPECT_EQ(tape.status().id, header_of(paths)->id);
    EXPECT_EQ(tape.status().silence, std::nullopt);
    tape.block(Direction::read, tape_time_us(1), {});
    EXPECT_EQ(tape.status().phase, LivePhase::queued) << "nothing is nothing";
    tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
    EXPECT_EQ(tape.status().phase, LivePhase::direct);
    EXPECT_FALSE(tape.queued());
    EXPECT_FALSE(tape.failing());
    EXPECT_EQ(read_size(), 15U);
    EXPECT_EQ(tape.status().bytes_written, 3U);
    tape.block(Direction::write, tape_time_us(2), as_bytes("de"));
    tape.note([](TapeWriter& writer) { writer.event(tape_time_us(3), event::Mark{"m"}); });
    tape.finish(tape_time_us(9));
    EXPECT_EQ(tape.status().phase, LivePhase::finished);
    EXPECT_TRUE(tape.status().over());
    EXPECT_EQ(tape.status().error, std::nullopt);
    EXPECT_EQ(tape.status().bytes_written, 5U);
    EXPECT_EQ(news, 2) << "that it is made, and that it is finished";
    tape.block(Direction::read, tape_time_us(10), as_bytes("late"));
    tape.lose(tape_time_us(11), 5, "late");
    EXPECT_EQ(tape.status().bytes_lost, 9U);
    EXPECT_EQ(tape.status().phase, LivePhase::finished);
  }));
  EXPECT_THAT(test::lines_on(paths),
              ElementsAre("r 1 abc", "w 2 de", R"({"t_us":3,"event":"mark","text":"m"})"));
}

TEST_F(LiveTapeAlone, OnADiskThatIsKnownToBeSlowItGoesOverTheQueue) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    disks->note_slow(disk());
    LiveTape tape(workers, disks, options());
    for (const std::int64_t us : {1, 2, 3}) {
      tape.block(Direction::read, tape_time_us(us), as_bytes("abc"));
      EXPECT_TRUE(tape.queued());
      EXPECT_EQ(tape.status().phase, LivePhase::queued);
      EXPECT_EQ(tape.status().bytes_waiting, 0U);
      EXPECT_EQ(read_size(), static_cast<std::size_t>(15 * us));
    }
    EXPECT_FALSE(tape.failing());
    tape.finish(tape_time_us(9));
  }));
}

TEST_F(LiveTapeAlone, ADiskThatTurnsOutToBeSlowForAnotherTapeIsSoForThisOne) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    LiveTape tape(workers, disks, options());
    tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
    EXPECT_FALSE(tape.queued());
    disks->note_slow(disk() + 1);
    tape.block(Direction::read, tape_time_us(2), as_bytes("abc"));
    EXPECT_FALSE(tape.queued());
    disks->note_slow(disk());
    tape.block(Direction::read, tape_time_us(3), as_bytes("abc"));
    EXPECT_TRUE(tape.queued());
    EXPECT_EQ(tape.status().phase, LivePhase::queued);
    tape.block(Direction::read, tape_time_us(4), as_bytes("abc"));
    EXPECT_TRUE(tape.queued()) << "for good";
    EXPECT_EQ(read_size(), 60U);
    tape.finish(tape_time_us(9));
    EXPECT_EQ(tape.status().bytes_written, 12U);
  }));
}

TEST_F(LiveTapeAlone, ABlockThatTheDiskDidNotTakeIsToldAtOnce) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    FaultyFiles files;
    LiveTape::Options made = options();
    made.make = [&](const LiveTape::Options& given) {
      return TapeWriter::on_sinks(faulty_sinks(files), given.header, given.writer);
    };
    LiveTape tape(workers, disks, std::move(made));
    tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
    files.error = EIO;
    tape.block(Direction::read, tape_time_us(2), as_bytes("abc"));
    EXPECT_TRUE(tape.failing());
    EXPECT_EQ(tape.status().failure, "Input/output error");
    EXPECT_EQ(tape.status().bytes_lost, 3U);
    files.error = 0;
    tape.block(Direction::read, tape_time_us(3), as_bytes("abc"));
    EXPECT_FALSE(tape.failing());
    EXPECT_EQ(tape.status().failure, "");
    tape.finish(tape_time_us(9));
    ASSERT_TRUE(tape.status().error);
    EXPECT_THAT(tape.status().error->message, HasSubstr("3 bytes and 0 events are missing"));
  }));
}

TEST_F(LiveTapeAlone, WithoutMemoryATapeThatIsThereIsGivenUpAndSaysSo) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    disks->note_slow(disk());
    LiveTape tape(workers, disks, options());
    tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
    EXPECT_EQ(news, 1);
    tape.note([](TapeWriter&) { throw std::bad_alloc(); });
    EXPECT_EQ(news, 2);
    EXPECT_EQ(tape.status().phase, LivePhase::not_made);
    EXPECT_TRUE(tape.status().over());
    EXPECT_EQ(*tape.status().error, make_error(Errc::io, "the tape is given up: std::bad_alloc"));
    EXPECT_EQ(tape.status().silence, std::nullopt);
    tape.block(Direction::read, tape_time_us(2), as_bytes("late"));
    EXPECT_EQ(tape.status().bytes_lost, 4U);
  }));
}

TEST_F(LiveTapeAlone, ATapeThatCannotBeMadeSaysWhyAtOnce) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    LiveTape::Options made = options();
    made.paths = literal_tape(dir / "no/t");
    LiveTape tape(workers, disks, std::move(made));
    EXPECT_EQ(tape.status().phase, LivePhase::not_made);
    EXPECT_THAT(tape.status().error->message, HasSubstr("type mkdir -p"));
    EXPECT_EQ(tape.status().paths.name(), dir / "no/t");
    EXPECT_EQ(news, 1);
    tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
    tape.finish(tape_time_us(2));
    EXPECT_EQ(tape.status().bytes_lost, 3U);
    EXPECT_FALSE(tape.failing());
  }));
}

TEST_F(LiveTapeAlone, ABlockAsLargeAsTheQueueFitsAndALargerOneIsLost) {
  EXPECT_TRUE(holds_without(kNoThreads, [this] {
    disks->note_slow(disk());
    LiveTape::Options made = options();
    made.queue_bytes = 10;
    LiveTape tape(workers, disks, std::move(made));
    tape.block(Direction::read, tape_time_us(1), as_bytes("1234567890"));
    EXPECT_EQ(tape.status().bytes_lost, 0U);
    tape.block(Direction::read, tape_time_us(2), as_bytes("12345678901"));
    EXPECT_EQ(tape.status().bytes_lost, 11U);
    tape.block(Direction::read, tape_time_us(3), as_bytes("x"));
    tape.finish(tape_time_us(9));
    EXPECT_EQ(tape.status().bytes_lost, 11U);
    EXPECT_TRUE(disks->reserve(Disks::kMostWaiting)) << "all room is given back";
  }));
  EXPECT_THAT(
      test::lines_on(paths),
      ElementsAre("r 1 1234567890",
                  R"({"t_us":3,"event":"gap","bytes":11,"from_us":2,"why":"the disk did not keep up"})",
                  "r 3 x"));
}

TEST_F(LiveTapeAlone, GoneAtOnceItTellsOfNothingWhereNothingWaits) {
  for (const bool slow : {false, true}) {
    const TapePaths made = literal_tape(dir / (slow ? "slow" : "direct"));
    EXPECT_TRUE(holds_without(kNoThreads, [&] {
      if (slow) disks->note_slow(disk());
      LiveTape::Options given = options();
      given.paths = made;
      LiveTape tape(workers, disks, std::move(given));
      tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
      EXPECT_EQ(tape.queued(), slow);
    }));
    EXPECT_THAT(test::lines_on(made), ElementsAre("r 1 abc"));
  }
}

TEST_F(LiveTapeAlone, GoneAfterItsEndItLeavesTheEndTheLast) {
  EXPECT_TRUE(holds_without(kNoThreads, [&] {
    Bytes ended;
    {
      LiveTape tape(workers, disks, options());
      tape.block(Direction::read, tape_time_us(1), as_bytes("abc"));
      tape.finish(tape_time_us(2));
      ended = test::read_file(paths.events);
    }
    EXPECT_EQ(test::read_file(paths.events), ended);
  }));
}

class TapeBatches : public testing::Test {
 protected:
  TapeWriter begin() {
    auto writer = TapeWriter::on_sinks(faulty_sinks(files), {"device", "driver"}, {.sync = true});
    if (!writer) throw std::runtime_error(writer.error().message);
    files.appended.clear();
    return std::move(*writer);
  }
  RunBoth in_turn() {
    return [this](const std::function<void()>& one, const std::function<void()>& other) {
      ++both;
      other();
      one();
    };
  }
  FaultyFiles files;
  int both = 0;
};

TEST_F(TapeBatches, WriteBothFilesAtTheSameTimeWhereBothHaveSomething) {
  TapeWriter writer = begin();
  writer.commit(in_turn());
  EXPECT_EQ(both, 0);
  writer.begin_batch();
  writer.read_block(tape_time_us(1), as_bytes("a"));
  writer.begin_batch();
  writer.read_block(tape_time_us(2), as_bytes("b"));
  EXPECT_TRUE(files.appended.empty());
  writer.commit(in_turn());
  EXPECT_EQ(both, 0);
  EXPECT_EQ(files.appended.size(), 1U);
  writer.begin_batch();
  writer.write_block(tape_time_us(3), as_bytes("c"));
  writer.commit(in_turn());
  EXPECT_EQ(both, 0);
  writer.begin_batch();
  writer.read_block(tape_time_us(4), as_bytes("d"));
  writer.write_block(tape_time_us(5), as_bytes("e"));
  writer.event(tape_time_us(6), event::Open{});
  writer.commit(in_turn());
  EXPECT_EQ(both, 1);
  EXPECT_EQ(files.appended.size(), 5U);
  EXPECT_EQ(writer.bytes_written(), 5U);
  EXPECT_TRUE(writer.finish(tape_time_us(9), in_turn()));
  EXPECT_EQ(both, 3) << "three files are brought to the disk";
}

TEST_F(TapeBatches, GoOnBehindWhatIsLost) {
  TapeWriter writer = begin();
  writer.begin_batch();
  writer.lose(tape_time_us(1), 5, "why");
  writer.read_block(tape_time_us(2), as_bytes("a"));
  EXPECT_TRUE(files.appended.empty()) << "it is a batch still";
  writer.commit();
  EXPECT_THAT(files.appended,
              ElementsAre(HasSubstr("a"), HasSubstr(R"("event":"gap","bytes":5,"from_us":1,"why":"why")")));
  files.appended.clear();
  writer.lose(tape_time_us(3), 6, "why");
  writer.read_block(tape_time_us(4), as_bytes("b"));
  EXPECT_EQ(files.appended.size(), 2U) << "it is none";
  EXPECT_EQ(writer.bytes_lost(), 11U);
}

TEST_F(TapeBatches, AGapWithoutABeginBeginsWhereItStands) {
  TapeWriter writer = begin();
  writer.event(tape_time_us(7), event::Gap{5, {}, "why"});
  writer.event(tape_time_us(8), event::Gap{5, tape_time_us(2), "why"});
  writer.event_line(tape_time_us(9), R"({"t_us":1,"event":"snow","new":1})");
  EXPECT_THAT(files.appended,
              ElementsAre("{\"t_us\":7,\"event\":\"gap\",\"bytes\":5,\"from_us\":7,\"why\":\"why\"}\n",
                          "{\"t_us\":8,\"event\":\"gap\",\"bytes\":5,\"from_us\":2,\"why\":\"why\"}\n",
                          "{\"t_us\":9,\"event\":\"snow\",\"new\":1}\n"));
}

TEST_F(TapeBatches, ALineThatWasLostIsToldByAGapAtTheNext) {
  TapeWriter writer = begin();
  files.error = ENOSPC;
  writer.event(tape_time_us(5), event::Mark{"lost"});
  EXPECT_TRUE(writer.failing());
  writer.begin_batch();
  writer.event(tape_time_us(6), event::Mark{"lost too"});
  writer.commit();
  files.error = 0;
  writer.event(tape_time_us(7), event::Mark{"kept"});
  EXPECT_FALSE(writer.failing());
  EXPECT_THAT(
      files.appended,
      ElementsAre(
          HasSubstr(R"({"t_us":7,"event":"gap","bytes":0,"from_us":5,"why":"No space left on device"})"),
          HasSubstr("kept")));
  EXPECT_EQ(writer.finish(tape_time_us(9)).error(),
            make_error(Errc::io, "0 bytes and 2 events are missing from the tape: No space left on device"));
}

TEST_F(TapeBatches, AfterAHeaderThatFailedNothingIsWritten) {
  files.error = EIO;
  EXPECT_EQ(TapeWriter::on_sinks(faulty_sinks(files), {"device", "driver"}, {}).error(),
            make_error(Errc::io, "Input/output error"));
  EXPECT_EQ(files.calls, 1);
}

TEST_F(TapeBatches, OneThatIsWrittenEndsAFailure) {
  TapeWriter writer = begin();
  files.error = ENOSPC;
  writer.read_block(tape_time_us(1), as_bytes("lost"));
  EXPECT_TRUE(writer.failing());
  files.error = 0;
  writer.begin_batch();
  writer.read_block(tape_time_us(2), as_bytes("kept"));
  writer.commit();
  EXPECT_FALSE(writer.failing());
  EXPECT_EQ(writer.bytes_lost(), 4U);
  EXPECT_EQ(writer.bytes_written(), 4U);
}

TEST(DisksTest, ADiskThatWasSlowOnceIsSlowForAllWhoAsk) {
  Disks disks;
  const auto asked_before = disks.slow(7);
  EXPECT_FALSE(*asked_before);
  disks.note_slow(7);
  EXPECT_TRUE(*asked_before);
  EXPECT_TRUE(*disks.slow(7));
  EXPECT_FALSE(*disks.slow(8));
}

TEST(DisksTest, AllQueuesTogetherHave256MebibytesOfRoom) {
  constexpr std::uint64_t most = std::uint64_t{256} << 20;
  Disks disks;
  EXPECT_FALSE(disks.reserve(most + 1));
  EXPECT_TRUE(disks.reserve(most - 1));
  EXPECT_TRUE(disks.reserve(1));
  EXPECT_FALSE(disks.reserve(1));
  disks.release(2);
  EXPECT_TRUE(disks.reserve(2));
  EXPECT_FALSE(disks.reserve(1));
}

}  // namespace
}  // namespace porttape
