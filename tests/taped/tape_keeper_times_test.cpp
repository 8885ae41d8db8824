// When the keeper of a tape tries again, and when it tells of a disk that fails or does not answer.

#include <atomic>
#include <cerrno>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/taped/tape_keeper.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/taking_sink.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;

class KeeperTimes : public testing::Test {
 protected:
  using Make = std::function<Result<TapeWriter>(const LiveTape::Options&)>;

  void keep(Make make, bool fail_closed = false, OnExisting on_existing = OnExisting::refuse) {
    keeper =
        std::make_unique<TapeKeeper>(PortContext{&loop, book.log()},
                                     TapeKeeper::Options{.tape = literal_tape(dir / "x.log"),
                                                         .header = {.device = "memory", .driver = "test"},
                                                         .on_existing = on_existing,
                                                         .fail_closed = fail_closed,
                                                         .make = std::move(make),
                                                         .disk_clock = &clock},
                                     [this] { ++must_ends; });
  }
  // Without waiting for other threads.
  void pass(Nanos time) {
    clock.pass(time);
    loop.clock_moved();
    loop.restart();
    while (loop.poll_one()) {
    }
  }
  void run_until_told(std::string_view text) {
    run_until(loop, [this, text] { return book.text().find(text) != std::string::npos; });
  }
  [[nodiscard]] int told(std::string_view text) const {
    const std::string all = book.text();
    int count = 0;
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }

  test::TempDir dir;
  ManualClock clock;
  Loop loop{clock, clock};
  LogBook book;
  int must_ends = 0;
  std::unique_ptr<TapeKeeper> keeper;
};

// The disk hangs while the tape's files are made.
class KeeperOfAHungDisk : public KeeperTimes {
 protected:
  ~KeeperOfAHungDisk() override { disk->goes_on.set_value(); }
  void open(bool fail_closed = false) {
    keep(
        [disk = disk](const LiveTape::Options&) -> Result<TapeWriter> {
          disk->reached.set_value();
          disk->goes_on.get_future().wait();
          return make_error(Errc::io, "a test wants it");
        },
        fail_closed);
    keeper->opened(loop.now());
    disk->reached.get_future().wait();
  }

  struct Disk {
    std::promise<void> reached;
    std::promise<void> goes_on;
  };
  std::shared_ptr<Disk> disk = std::make_shared<Disk>();
};

TEST_F(KeeperOfAHungDisk, TellsOfItOnceAfterASecond) {
  open();
  keeper->block(Direction::read, loop.now(), as_bytes("seven b"));
  for (int looks = 0; looks < 3; ++looks) pass(milliseconds(250));
  EXPECT_EQ(book.text(), "");
  pass(milliseconds(250));
  EXPECT_THAT(book.text(), HasSubstr("x.log: its disk does not answer; 7 bytes wait for it"));
  for (int looks = 0; looks < 8; ++looks) pass(milliseconds(250));
  EXPECT_EQ(told("does not answer"), 1);
  EXPECT_EQ(must_ends, 0);
  keeper->give_up();
}

TEST_F(KeeperOfAHungDisk, FailClosedEndsTheLineWithinTwoSeconds) {
  open(true);
  pass(milliseconds(250));
  pass(milliseconds(250));
  EXPECT_EQ(must_ends, 0);
  pass(milliseconds(250));
  EXPECT_EQ(must_ends, 1);
  EXPECT_EQ(told("does not answer"), 0) << "that is told after a second";
  keeper->give_up();
}

// Fails at first; the error has the attempt's number.
class KeeperWithoutATape : public KeeperTimes {
 protected:
  void open(int failures) {
    keep([this, failures](const LiveTape::Options& tape) -> Result<TapeWriter> {
      const int attempt = ++attempts;
      if (attempt <= failures || fails) return make_error(Errc::io, "attempt " + std::to_string(attempt));
      return TapeWriter::create(tape.paths, tape.header, tape.writer);
    });
    keeper->opened(loop.now());
  }
  // How long it waits after that attempt.
  Nanos wait_after(int attempt) {
    run_until_told("attempt " + std::to_string(attempt) + ";");
    const std::optional<Instant> next = loop.next_timer();
    return next ? *next - clock.now() : Nanos{};
  }

  std::atomic<int> attempts = 0;
  std::atomic<bool> fails = false;
};

TEST_F(KeeperWithoutATape, TriesAgainAfterASecondAndThenEachTimeTwiceAsLateUpToHalfAMinute) {
  open(8);
  int attempt = 1;
  for (const int due : {1, 2, 4, 8, 16, 30, 30}) {
    EXPECT_EQ(wait_after(attempt), seconds(due)) << attempt;
    pass(seconds(due));
    ++attempt;
  }
  EXPECT_EQ(wait_after(attempt), seconds(30));
}

TEST_F(KeeperWithoutATape, BeginsWithASecondAgainOnceATapeWasMade) {
  open(2);
  for (const int attempt : {1, 2}) pass(wait_after(attempt));
  run_until_told("recording to");
  fails = true;
  EXPECT_TRUE(keeper->request(loop.now(), RecorderRequest::next_tape()));
  EXPECT_EQ(wait_after(4), seconds(1));
}

TEST_F(KeeperTimes, WithoutADriverNothingIsMissedAndNothingTold) {
  keep({});
  keeper->block(Direction::read, loop.now(), as_bytes("before any driver"));
  std::optional<bool> complete;
  keeper->finish(loop.now(), [&complete](bool all) { complete = all; });
  EXPECT_EQ(complete, true);
  EXPECT_EQ(book.text(), "");
}

TEST_F(KeeperWithoutATape, WhereNoBytesPassedTheReasonAloneIsTold) {
  open(1);
  (void)wait_after(1);
  EXPECT_EQ(keeper->recording()->state, RecordingStatus::State::not_made);
  EXPECT_EQ(keeper->recording()->why, "attempt 1");
  EXPECT_EQ(keeper->recording()->lost_bytes, 0U);
  keeper->block(Direction::read, loop.now(), as_bytes("lost"));
  keeper->block(Direction::write, loop.now(), as_bytes("too"));
  EXPECT_EQ(keeper->recording()->lost_bytes, 7U);
  keeper->give_up();
  EXPECT_EQ(told("7 bytes passed and are on no tape: attempt 1"), 1);
}

TEST_F(KeeperWithoutATape, OneThatHasAllOfItIsGivenUpSilently) {
  open(0);
  run_until_told("recording to");
  keeper->block(Direction::read, loop.now(), as_bytes("kept"));
  run_until(loop, [this] { return keeper->recording()->queued_bytes == 0; });
  keeper->give_up();
  EXPECT_EQ(told("did not answer"), 0);
}

// A disk that can be full.
class FullSink final : public test::TakingSink {
 public:
  explicit FullSink(std::shared_ptr<std::atomic<bool>> full) : full_(std::move(full)) {}
  Appended append(ByteView head, ByteView body) override {
    if (*full_) return {0, ENOSPC};
    return TakingSink::append(head, body);
  }

 private:
  std::shared_ptr<std::atomic<bool>> full_;
};

// Which is nearly full: it takes one block, and not the next.
class KeeperOfAFullDisk : public KeeperTimes {
 protected:
  void open(bool fail_closed = false) {
    keep(
        [full = full](const LiveTape::Options& tape) {
          return TapeWriter::on_sinks({std::make_unique<FullSink>(full), std::make_unique<FullSink>(full),
                                       std::make_unique<FullSink>(full)},
                                      tape.header, tape.writer);
        },
        fail_closed);
    keeper->opened(loop.now());
    run_until_told("recording to");
    block(false);
  }
  void block(bool is_full) {
    *full = is_full;
    keeper->block(Direction::read, loop.now(), as_bytes("x"));
    pass(Nanos{});
  }

  std::shared_ptr<std::atomic<bool>> full = std::make_shared<std::atomic<bool>>(false);
};

TEST_F(KeeperOfAFullDisk, IsToldOnceASecondThatItIsFull) {
  open();
  block(true);
  EXPECT_EQ(told("x.log: No space left on device; the line stays up, the loss is counted"), 1);
  EXPECT_EQ(keeper->recording()->state, RecordingStatus::State::failing);
  EXPECT_EQ(keeper->recording()->why, "No space left on device");
  block(false);
  EXPECT_EQ(told("x.log is being written again; "), 1);
  EXPECT_EQ(keeper->recording()->state, RecordingStatus::State::recording);
  pass(seconds(1) - microseconds(1));
  block(true);
  EXPECT_EQ(told("No space left on device"), 1);
  block(false);
  EXPECT_EQ(told("is being written again"), 1) << "of what was not told nothing is taken back";
  pass(microseconds(1));
  block(true);
  EXPECT_EQ(told("No space left on device"), 2);
  block(false);
  EXPECT_EQ(told("is being written again"), 2);
  EXPECT_EQ(must_ends, 0);
}

TEST_F(KeeperOfAFullDisk, RefusesAMarkThatCannotBeWritten) {
  open();
  *full = true;
  const Result<bool> marked = keeper->request(loop.now(), RecorderRequest::mark("lost"));
  ASSERT_FALSE(marked);
  EXPECT_EQ(marked.error().message,
            "tape " + (dir / "x.log") + ": nothing can be written on it now: No space left on device");
  *full = false;
  EXPECT_TRUE(keeper->request(loop.now(), RecorderRequest::mark("there is room again")));
}

TEST_F(KeeperOfAFullDisk, FailClosedEndsTheLineAtTheFirstLoss) {
  open(true);
  EXPECT_EQ(must_ends, 0);
  block(true);
  EXPECT_GE(must_ends, 1);
  EXPECT_EQ(told("No space left on device; ending, as --fail-closed asks"), 1);
}

// Does not bring to the disk what it has, once.
class OnceUnsafeSink final : public test::TakingSink {
 public:
  explicit OnceUnsafeSink(std::shared_ptr<std::atomic<bool>> fails) : fails_(std::move(fails)) {}
  Sync syncer() override {
    return [fails = fails_] { return fails->exchange(false) ? EIO : 0; };
  }

 private:
  std::shared_ptr<std::atomic<bool>> fails_;
};

TEST_F(KeeperTimes, WhatMayNotBeOnTheDiskMakesTheRecordingIncompleteThoughTheEndIs) {
  const auto fails = std::make_shared<std::atomic<bool>>(false);
  keep([fails](const LiveTape::Options& tape) {
    return TapeWriter::on_sinks(
        {std::make_unique<OnceUnsafeSink>(fails), std::make_unique<OnceUnsafeSink>(fails),
         std::make_unique<OnceUnsafeSink>(fails)},
        tape.header, tape.writer);
  });
  keeper->opened(loop.now());
  run_until_told("recording to");
  *fails = true;
  keeper->block(Direction::read, loop.now(), as_bytes("x"));
  run_until_told("what was written may not be on the disk: Input/output error");
  std::optional<bool> complete;
  keeper->finish(loop.now(), [&complete](bool all) { complete = all; });
  run_until(loop, [&complete] { return complete.has_value(); });
  EXPECT_EQ(complete, false);
  EXPECT_EQ(told("may not be on the disk"), 1);
  EXPECT_EQ(told(" is complete: "), 1) << "which its end is";
}

// A disk that works, is slow once, and then hangs.
struct TiringDisk {
  enum class Pace { works, slow, hangs };
  std::atomic<Pace> pace = Pace::works;
  std::promise<void> reached;
  std::promise<void> goes_on;
};
class TiringSink final : public test::TakingSink {
 public:
  TiringSink(std::shared_ptr<TiringDisk> disk, ManualClock& clock) : disk_(std::move(disk)), clock_(clock) {}
  Appended append(ByteView head, ByteView body) override {
    if (disk_->pace == TiringDisk::Pace::slow) clock_.pass(LiveTape::kHungWrite);
    if (disk_->pace == TiringDisk::Pace::hangs) {
      disk_->reached.set_value();
      disk_->goes_on.get_future().wait();
    }
    return TakingSink::append(head, body);
  }

 private:
  std::shared_ptr<TiringDisk> disk_;
  ManualClock& clock_;
};

TEST_F(KeeperTimes, ADiskThatHangsLongAfterItAnsweredIsToldOfToo) {
  const auto disk = std::make_shared<TiringDisk>();
  keep([this, disk](const LiveTape::Options& tape) {
    return TapeWriter::on_sinks(
        {std::make_unique<TiringSink>(disk, clock), std::make_unique<TiringSink>(disk, clock),
         std::make_unique<TiringSink>(disk, clock)},
        tape.header, tape.writer);
  });
  keeper->opened(loop.now());
  run_until_told("recording to");
  pass(seconds(1));
  keeper->block(Direction::read, loop.now(), as_bytes("directly"));
  EXPECT_EQ(loop.next_timer(), std::nullopt) << "a disk that is waited for need not be looked at";
  disk->pace = TiringDisk::Pace::slow;
  keeper->block(Direction::read, loop.now(), as_bytes("slowly"));
  run_until_told("its disk took 100 ms for a write; what is recorded goes over a queue from now on");
  pass(seconds(1));
  EXPECT_EQ(loop.next_timer(), std::nullopt) << "nothing waits for it";
  disk->pace = TiringDisk::Pace::hangs;
  keeper->block(Direction::read, loop.now(), as_bytes("too late"));
  disk->reached.get_future().wait();
  for (int looks = 0; looks < 4; ++looks) pass(milliseconds(250));
  EXPECT_EQ(told("x.log: its disk does not answer; 8 bytes wait for it"), 1) << book.text();
  keeper->give_up();
  disk->pace = TiringDisk::Pace::works;
  disk->goes_on.set_value();
}

// On files; notes which number the next one may have.
class KeeperOfFiles : public KeeperTimes {
 protected:
  void open(OnExisting on_existing = OnExisting::refuse) {
    keep(
        [this](const LiveTape::Options& tape) -> Result<TapeWriter> {
          const std::lock_guard lock(mutex);
          numbers.push_back(tape.writer.first_number);
          if (fails) return make_error(Errc::io, "no disk");
          return TapeWriter::create(tape.paths, tape.header, tape.writer);
        },
        false, on_existing);
    keeper->opened(loop.now());
  }
  [[nodiscard]] std::vector<unsigned> numbers_so_far() {
    const std::lock_guard lock(mutex);
    return numbers;
  }
  void next_tape() { EXPECT_TRUE(keeper->request(loop.now(), RecorderRequest::next_tape())); }
  void run_until_told_times(std::string_view text, int times) {
    run_until(loop, [&] { return told(text) >= times; });
  }
  bool finish() {
    std::optional<bool> complete;
    keeper->finish(loop.now(), [&complete](bool all) { complete = all; });
    run_until(loop, [&complete] { return complete.has_value(); });
    return *complete;
  }

  std::mutex mutex;
  std::vector<unsigned> numbers;
  std::atomic<bool> fails = false;
};

TEST_F(KeeperOfFiles, EachTapeIsToldOfAndHasANumberMore) {
  open();
  run_until_told_times("recording to", 1);
  EXPECT_EQ(keeper->recording()->tape, dir / "x.log");
  for (const int tape : {2, 3}) {
    next_tape();
    run_until_told_times("recording to", tape);
    EXPECT_EQ(keeper->recording()->tape, dir / ("x." + std::to_string(tape) + ".log"));
  }
  EXPECT_TRUE(finish());
  EXPECT_EQ(numbers_so_far(), (std::vector<unsigned>{1, 2, 3}));
  EXPECT_EQ(keeper->recording(), std::nullopt);
}

TEST_F(KeeperOfFiles, WhyNoneCanBeMadeIsToldAgainOnceOneWasMade) {
  fails = true;
  open();
  run_until_told_times("no disk; nothing is recorded until that is mended", 1);
  fails = false;
  pass(seconds(1));
  run_until_told_times("recording to", 1);
  fails = true;
  next_tape();
  run_until_told_times("no disk; nothing is recorded until that is mended", 2);
}

TEST_F(KeeperOfFiles, AfterTheEndNoneIsTriedAgain) {
  fails = true;
  open();
  run_until_told_times("no disk", 1);
  EXPECT_FALSE(finish());
  fails = false;
  pass(seconds(60));
  EXPECT_EQ(numbers_so_far().size(), 1U);
  EXPECT_EQ(loop.next_timer(), std::nullopt);
}

TEST_F(KeeperOfFiles, AnEndClosesTheSessionThatIsOpen) {
  open();
  run_until_told_times("recording to", 1);
  EXPECT_TRUE(finish());
  const std::string events(as_text(test::read_file(dir / "x.loge")));
  EXPECT_THAT(events, HasSubstr(R"("event":"close")"));
  EXPECT_LT(events.find(R"("event":"close")"), events.find(R"("event":"end")"));
}

TEST_F(KeeperOfFiles, WhatReplacesOthersWaitsForALineThatComesUpForADriver) {
  open(OnExisting::overwrite);
  keeper->closed(loop.now());
  keeper->came_up(loop.now());
  EXPECT_EQ(keeper->recording()->state, RecordingStatus::State::waiting) << "the driver has gone";
  keeper->opened(loop.now());
  EXPECT_EQ(keeper->recording()->state, RecordingStatus::State::waiting);
  keeper->came_up(loop.now());
  run_until_told_times("recording to", 1);
  EXPECT_TRUE(finish());
}

TEST_F(KeeperOfAFullDisk, SaysHowMuchIsOnTheTapeAndHowMuchIsLost) {
  open();
  EXPECT_EQ(keeper->recording()->bytes, 1U);
  EXPECT_EQ(keeper->recording()->lost_bytes, 0U);
  block(true);
  block(true);
  EXPECT_EQ(keeper->recording()->bytes, 1U);
  EXPECT_EQ(keeper->recording()->lost_bytes, 2U);
  EXPECT_EQ(keeper->recording()->queued_bytes, 0U);
}

TEST_F(KeeperOfAHungDisk, SaysHowMuchWaitsForIt) {
  open();
  keeper->block(Direction::read, loop.now(), as_bytes("seven b"));
  EXPECT_EQ(keeper->recording()->queued_bytes, 7U);
  EXPECT_EQ(keeper->recording()->bytes, 0U);
  keeper->give_up();
}

}  // namespace
}  // namespace porttape
