// A tape whose disk hangs: the caller waits once at most, and nothing is lost untold.

#include "libport/tape/live_tape.hpp"

#include <array>
#include <cerrno>
#include <condition_variable>
#include <future>
#include <new>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using Phase = LiveTape::Status::Phase;
using testing::ElementsAre;

// Three files in memory on a disk that a test can hang.
class HangingDisk {
 public:
  void hang() { set(true); }
  void go_on() { set(false); }

  // For the disk's own thread: waits while it hangs.
  void wait() {
    std::unique_lock lock(mutex_);
    ++waiting_;
    changed_.notify_all();
    changed_.wait(lock, [this] { return !hangs_; });
    --waiting_;
  }
  void wait_until_reached() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return waiting_ > 0; });
  }

  std::array<Bytes, 3> files{};
  std::array<int, 3> appends{};
  std::atomic<int> sync_result = 0;
  std::atomic<int> closed = 0;  // files

 private:
  void set(bool hangs) {
    const std::lock_guard lock(mutex_);
    hangs_ = hangs;
    changed_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  bool hangs_ = false;
  int waiting_ = 0;
};

class HangingSink final : public TapeSink {
 public:
  HangingSink(std::shared_ptr<HangingDisk> disk, std::size_t file) : disk_(std::move(disk)), file_(file) {}
  Appended append(ByteView head, ByteView body) override {
    disk_->wait();
    ++disk_->appends.at(file_);
    Bytes& bytes = disk_->files.at(file_);
    bytes.insert(bytes.end(), head.begin(), head.end());
    bytes.insert(bytes.end(), body.begin(), body.end());
    return {head.size() + body.size(), 0};
  }
  int truncate(std::uint64_t) override { return 0; }
  Sync syncer() override {
    return [disk = disk_] { return disk->sync_result.load(); };
  }
  int close() override {
    ++disk_->closed;
    return 0;
  }

 private:
  std::shared_ptr<HangingDisk> disk_;
  std::size_t file_;
};

class LiveTapeTest : public testing::Test {
 protected:
  // A thread that waits for news.
  struct News {
    std::mutex mutex;
    std::condition_variable come;
    int count = 0;
  };

  std::unique_ptr<LiveTape> make_tape(std::size_t queue_bytes = 1000, LiveTape::Note fill = {}) {
    LiveTape::Options options{.paths = literal_tape("memory"),
                              .header = {"device", "driver"},
                              .queue_bytes = queue_bytes,
                              .fill = std::move(fill)};
    options.on_news = [news = news] {
      const std::lock_guard lock(news->mutex);
      ++news->count;
      news->come.notify_all();
    };
    options.disk_clock = &clock;
    options.make = [disk = disk](const LiveTape::Options& given) {
      return TapeWriter::on_sinks(
          {std::make_unique<HangingSink>(disk, 0), std::make_unique<HangingSink>(disk, 1),
           std::make_unique<HangingSink>(disk, 2)},
          given.header, given.writer);
    };
    return std::make_unique<LiveTape>(workers, disks, std::move(options));
  }
  template <class Condition>
  void wait_for_news(const Condition& condition) {
    std::unique_lock lock(news->mutex);
    news->come.wait(lock, condition);
  }
  void wait_until_direct(LiveTape& tape) {
    wait_for_news([&] { return tape.status().phase != Phase::being_made; });
    tape.note([](TapeWriter&) {});
    while (tape.status().phase != Phase::direct) {
      std::this_thread::yield();
      tape.note([](TapeWriter&) {});
    }
  }
  // A block whose write takes longer than the caller ever waits again.
  void block_late(LiveTape& tape, std::int64_t us) {
    disk->hang();
    std::thread later([this] {
      disk->wait_until_reached();
      clock.pass(LiveTape::kHungWrite * 3 / 2);
      disk->go_on();
    });
    tape.block(Direction::read, tape_time_us(us), as_bytes("late"));
    later.join();
  }
  void finish(LiveTape& tape, std::int64_t us) {
    tape.finish(tape_time_us(us));
    wait_for_news([&] { return tape.status().over(); });
  }
  std::vector<std::string> records() {
    auto reader =
        TapeReader::from_sources({test::memory("r", disk->files[0]), test::memory("w", disk->files[1]),
                                  test::memory("e", disk->files[2])});
    if (!reader) return {reader.error().message};
    return test::read_all(*reader);
  }

  ManualClock clock;  // how long the disk takes: the machine may be slow meanwhile
  std::shared_ptr<HangingDisk> disk = std::make_shared<HangingDisk>();
  std::shared_ptr<News> news = std::make_shared<News>();
  std::shared_ptr<Disks> disks = std::make_shared<Disks>();
  Workers workers;
};

TEST_F(LiveTapeTest, WhatComesWhileTheFilesAreMadeIsOnTheTape) {
  disk->hang();
  const auto tape = make_tape();
  disk->wait_until_reached();
  EXPECT_EQ(tape->status().phase, Phase::being_made);
  tape->note([](TapeWriter& writer) { writer.event(tape_time_us(0), event::Open{}); });
  tape->block(Direction::write, tape_time_us(5), as_bytes("ask"));
  tape->block(Direction::read, tape_time_us(9), as_bytes("answer"));
  EXPECT_EQ(tape->status().bytes_waiting, 9U);
  disk->go_on();
  finish(*tape, 20);
  EXPECT_EQ(tape->status().error, std::nullopt);
  EXPECT_THAT(records(), ElementsAre("open 0", "w 5 ask", "r 9 answer", "end 20"));
}

TEST_F(LiveTapeTest, TheCallerWritesItselfWhileTheDiskAnswers) {
  const auto tape = make_tape();
  wait_until_direct(*tape);
  tape->block(Direction::write, tape_time_us(5), as_bytes("ask"));
  EXPECT_EQ(disk->files[1].size(), 12U + 3U);  // it is there when the call returns
  finish(*tape, 20);
}

TEST_F(LiveTapeTest, AfterOneLongWriteTheCallerNeverWaitsAgain) {
  const auto tape = make_tape();
  wait_until_direct(*tape);
  block_late(*tape, 10);
  EXPECT_EQ(tape->status().phase, Phase::queued);
  EXPECT_GE(tape->status().slowest, LiveTape::kHungWrite);

  disk->hang();
  for (int i = 0; i < 20; ++i) {
    tape->block(Direction::read, tape_time_us(20 + i), as_bytes("r"));
    tape->block(Direction::write, tape_time_us(20 + i), as_bytes("w"));
  }
  disk->wait_until_reached();
  const std::array<int, 3> before = disk->appends;
  disk->go_on();
  finish(*tape, 100);
  EXPECT_EQ(tape->status().error, std::nullopt);
  EXPECT_EQ(records().size(), 1U + 40U + 1U);
  EXPECT_LE(disk->appends[0] - before[0], 2) << "what gathers is written in one go";
}

TEST_F(LiveTapeTest, AfterALongWriteOfTheQueueBothFilesAreWrittenWhole) {
  const auto tape = make_tape();
  wait_until_direct(*tape);
  block_late(*tape, 10);
  disk->hang();
  tape->block(Direction::read, tape_time_us(20), as_bytes("queued"));
  disk->wait_until_reached();
  clock.pass(LiveTape::kHungWrite * 3 / 2);
  tape->block(Direction::read, tape_time_us(30), as_bytes("r"));
  tape->block(Direction::write, tape_time_us(31), as_bytes("w"));
  disk->go_on();
  finish(*tape, 100);
  EXPECT_THAT(records(), ElementsAre("r 10 late", "r 20 queued", "r 30 r", "w 31 w", "end 100"));
}

TEST_F(LiveTapeTest, AnotherTapeOfASlowDiskGoesOverAQueueToo) {
  (void)disks->slow(7);
  EXPECT_FALSE(*disks->slow(7));
  disks->note_slow(7);
  EXPECT_TRUE(*disks->slow(7));
  EXPECT_FALSE(*disks->slow(8));
}

TEST_F(LiveTapeTest, WhatItIsFilledWithComesFirstAndHoldsUpNobody) {
  disk->hang();
  std::atomic<bool> here = false;
  const auto tape = make_tape(1000, [&here, caller = std::this_thread::get_id()](TapeWriter& writer) {
    here = std::this_thread::get_id() == caller;
    writer.begin_batch();
    writer.read_block(tape_time_us(1), as_bytes("kept"));
    writer.write_block(tape_time_us(2), as_bytes("so far"));
    writer.commit();
  });
  tape->block(Direction::read, tape_time_us(3), as_bytes("new"));
  tape->finish(tape_time_us(4));
  disk->go_on();
  wait_for_news([&] { return tape->status().over(); });
  EXPECT_THAT(records(), ElementsAre("r 1 kept", "w 2 so far", "r 3 new", "end 4"));
  EXPECT_EQ(tape->status().bytes_written, 13U);
  EXPECT_FALSE(here);
}

TEST_F(LiveTapeTest, WhatItIsFilledWithIsCountedAtOnce) {
  const auto tape =
      make_tape(1000, [](TapeWriter& writer) { writer.read_block(tape_time_us(1), as_bytes("kept")); });
  wait_for_news([&] { return tape->status().phase != Phase::being_made; });
  EXPECT_EQ(tape->status().bytes_written, 4U);
}

TEST_F(LiveTapeTest, WithoutAnyoneWhoKnowsTheDisksItLearnsForItself) {
  disks.reset();
  const auto tape = make_tape();
  tape->block(Direction::read, tape_time_us(1), as_bytes("one"));
  wait_until_direct(*tape);
  finish(*tape, 2);
  EXPECT_THAT(records(), ElementsAre("r 1 one", "end 2"));
}

TEST_F(LiveTapeTest, TheSyncsOfOneDiskRunInTurnAndHoldUpNoOther) {
  std::promise<void> go_on;
  std::promise<void> other_disk;
  std::promise<void> last;
  std::vector<int> order;
  ASSERT_TRUE(workers.post(disks->sync_strand(7), [&] {
    go_on.get_future().wait();
    order.push_back(1);
  }));
  ASSERT_TRUE(workers.post(disks->sync_strand(7), [&] {
    order.push_back(2);
    last.set_value();
  }));
  ASSERT_TRUE(workers.post(disks->sync_strand(8), [&] { other_disk.set_value(); }));
  other_disk.get_future().wait();
  go_on.set_value();
  last.get_future().wait();
  EXPECT_THAT(order, ElementsAre(1, 2));
}

TEST_F(LiveTapeTest, WhatTheQueueDoesNotHoldIsAGapWhereItWas) {
  disk->hang();  // before its thread can have made the files
  const auto tape = make_tape(10);
  disk->wait_until_reached();
  tape->block(Direction::read, tape_time_us(10), as_bytes("12345678"));
  tape->block(Direction::read, tape_time_us(20), as_bytes("lost"));
  tape->block(Direction::write, tape_time_us(30), as_bytes("lost"));
  disk->go_on();
  while (tape->status().bytes_waiting > 0) std::this_thread::yield();
  tape->block(Direction::read, tape_time_us(40), as_bytes("kept"));
  finish(*tape, 50);
  EXPECT_THAT(records(), ElementsAre("r 10 12345678", "gap 40", "r 40 kept", "end 50"));
  EXPECT_EQ(tape->status().bytes_lost, 8U);
  EXPECT_TRUE(tape->status().error);
  const auto summary = summarize("t", {test::memory("r", disk->files[0]), test::memory("w", disk->files[1]),
                                       test::memory("e", disk->files[2])});
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->events.gap_bytes, 8U);
}

TEST_F(LiveTapeTest, OverflowAtTheEndIsToldOnTheTapeToo) {
  disk->hang();  // before its thread can have made the files
  const auto tape = make_tape(10);
  disk->wait_until_reached();
  tape->block(Direction::read, tape_time_us(10), as_bytes("12345678"));
  tape->block(Direction::read, tape_time_us(20), as_bytes("lost"));
  tape->finish(tape_time_us(50));
  disk->go_on();
  wait_for_news([&] { return tape->status().over(); });
  EXPECT_THAT(records(), ElementsAre("r 10 12345678", "gap 50", "end 50"));
}

TEST_F(LiveTapeTest, WhoSeesItFinishedSeesAllThatIsOnIt) {
  disk->hang();
  const auto tape = make_tape();
  tape->block(Direction::read, tape_time_us(10), as_bytes("four"));
  tape->finish(tape_time_us(20));
  std::optional<LiveTape::Status> seen;  // right behind the end, in the same batch
  tape->note([&](TapeWriter&) { seen = tape->status(); });
  disk->go_on();
  wait_for_news([&] { return tape->status().over(); });
  EXPECT_EQ(tape->status().bytes_written, 4U);
  ASSERT_TRUE(seen.has_value());
  EXPECT_TRUE(!seen->over() || seen->bytes_written == 4U);
}

TEST_F(LiveTapeTest, ATapeThatCannotBeMadeSaysWhyAndCountsWhatItMisses) {
  const test::TempDir dir;
  LiveTape::Options options{.paths = literal_tape(dir / "missing/t.log"), .header = {"device", "driver"}};
  options.on_news = [news = news] {
    const std::lock_guard lock(news->mutex);
    news->come.notify_all();
  };
  LiveTape tape(workers, disks, std::move(options));
  tape.block(Direction::read, tape_time_us(1), as_bytes("one"));
  wait_for_news([&] { return tape.status().over(); });
  tape.block(Direction::read, tape_time_us(2), as_bytes("two"));
  EXPECT_EQ(tape.status().phase, Phase::not_made);
  ASSERT_TRUE(tape.status().error);
  EXPECT_EQ(tape.status().bytes_lost, 6U);
}

TEST_F(LiveTapeTest, WithoutMemoryItIsGivenUpAndCountsWhatItMisses) {
  LiveTape::Options options{.paths = {}, .header = {"device", "driver"}};
  options.make = [](const LiveTape::Options&) -> Result<TapeWriter> { throw std::bad_alloc(); };
  options.on_news = [news = news] {
    const std::lock_guard lock(news->mutex);
    news->come.notify_all();
  };
  LiveTape tape(workers, disks, std::move(options));
  tape.block(Direction::read, tape_time_us(1), as_bytes("one"));
  wait_for_news([&] { return tape.status().over(); });
  EXPECT_EQ(tape.status().phase, Phase::not_made);
  EXPECT_EQ(tape.status().bytes_lost, 3U);
}

TEST_F(LiveTapeTest, WhatWaitedForATapeThatIsNotMadeIsLostAndItsRoomGivenBack) {
  std::promise<void> go_on;
  LiveTape::Options options{.paths = {}, .header = {"device", "driver"}};
  options.make = [&go_on](const LiveTape::Options&) -> Result<TapeWriter> {
    go_on.get_future().wait();
    return make_error(Errc::io, "no disk");
  };
  options.on_news = [news = news] {
    const std::lock_guard lock(news->mutex);
    news->come.notify_all();
  };
  LiveTape tape(workers, disks, std::move(options));
  tape.block(Direction::read, tape_time_us(1), as_bytes("one"));
  EXPECT_EQ(tape.status().bytes_waiting, 3U);
  EXPECT_FALSE(disks->reserve(Disks::kMostWaiting));
  go_on.set_value();
  wait_for_news([&] { return tape.status().over(); });
  EXPECT_EQ(tape.status().bytes_waiting, 0U);
  EXPECT_EQ(tape.status().bytes_lost, 3U);
  EXPECT_TRUE(disks->reserve(Disks::kMostWaiting));
}

TEST_F(LiveTapeTest, AFailedSyncIsToldAtOnce) {
  disk->sync_result = EIO;
  const auto tape = make_tape();
  tape->block(Direction::read, tape_time_us(1), as_bytes("one"));
  wait_for_news([&] { return tape->status().sync_error == EIO; });
}

TEST_F(LiveTapeTest, GoneAtOnceItLeavesASoundTapeThatSaysWhatIsMissing) {
  disk->hang();  // before its thread can have made the files
  auto tape = make_tape();
  disk->wait_until_reached();
  tape->block(Direction::read, tape_time_us(10), as_bytes("given up"));
  tape.reset();
  disk->go_on();
  while (disk->closed < 3) std::this_thread::yield();  // its worker lets it go behind everybody's back
  EXPECT_THAT(records(), ElementsAre("gap 10", "end 10"));
}

TEST_F(LiveTapeTest, GoneAtOnceItSaysWhatFoundNoRoomToo) {
  disk->hang();  // before its thread can have made the files
  auto tape = make_tape(10);
  disk->wait_until_reached();
  tape->lose(tape_time_us(5), 100, "a test wants it");
  tape->block(Direction::read, tape_time_us(10), as_bytes("12345678"));
  tape->block(Direction::read, tape_time_us(20), as_bytes("lost"));
  tape->finish(tape_time_us(30));
  EXPECT_EQ(tape->status().bytes_waiting, 8U);
  EXPECT_EQ(tape->status().bytes_lost, 104U);
  tape.reset();
  disk->go_on();
  while (disk->closed < 3) std::this_thread::yield();
  const auto summary = summarize("t", {test::memory("r", disk->files[0]), test::memory("w", disk->files[1]),
                                       test::memory("e", disk->files[2])});
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->events.gap_bytes, 112U);
}

TEST_F(LiveTapeTest, WhatWasLostBeforeItCameIsAGapInItsPlace) {
  const auto tape = make_tape();
  tape->block(Direction::read, tape_time_us(10), as_bytes("one"));
  tape->lose(tape_time_us(20), 5, "a test wants it");
  tape->block(Direction::read, tape_time_us(30), as_bytes("two"));
  wait_until_direct(*tape);
  tape->lose(tape_time_us(40), 6, "a test wants it");
  tape->block(Direction::read, tape_time_us(50), as_bytes("three"));
  EXPECT_EQ(tape->status().bytes_lost, 11U);
  finish(*tape, 60);
  EXPECT_EQ(tape->status().bytes_lost, 11U);
  EXPECT_THAT(records(), ElementsAre("r 10 one", "gap 30", "r 30 two", "gap 50", "r 50 three", "end 60"));
}

}  // namespace
}  // namespace porttape
