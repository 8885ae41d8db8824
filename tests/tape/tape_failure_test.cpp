// A tape whose disk fails at the Nth operation, for every N, must be sound, and what is missing must be
// counted.

#include <array>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <future>
#include <memory>
#include <sys/resource.h>
#include <thread>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_summary.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// The disk under the three sinks: operations are counted, those from first_bad to last_bad fail.
struct Disk {
  int operation = 0;
  int first_bad = -1;
  int last_bad = -1;
  bool truncate_fails = true;  // as an operation that can be hit; else it always works
  std::size_t torn = 0;        // how much of a failing append goes in
  std::array<Bytes, 3> files{};

  bool fails() {
    const int now = operation++;
    return now >= first_bad && now <= last_bad;
  }
};

class FailingSink final : public TapeSink {
 public:
  FailingSink(Disk& disk, Bytes& file) : disk_(disk), file_(file) {}
  Appended append(ByteView head, ByteView body) override {
    Bytes all(head.begin(), head.end());
    all.insert(all.end(), body.begin(), body.end());
    const bool fails = disk_.fails();
    const std::size_t count = fails ? std::min(disk_.torn, all.size() - 1) : all.size();
    file_.insert(file_.end(), all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count));
    return {count, fails ? ENOSPC : 0};
  }
  int truncate(std::uint64_t size) override {
    if (disk_.truncate_fails && disk_.fails()) return EIO;
    EXPECT_LE(size, file_.size());
    file_.resize(static_cast<std::size_t>(size));
    return 0;
  }
  Sync syncer() override {
    return [] { return 0; };
  }
  int close() override { return 0; }

 private:
  Disk& disk_;
  Bytes& file_;
};

TapeSinks sinks_on(Disk& disk) {
  return {std::make_unique<FailingSink>(disk, disk.files[0]),
          std::make_unique<FailingSink>(disk, disk.files[1]),
          std::make_unique<FailingSink>(disk, disk.files[2])};
}

TapeSources sources_on(const Disk& disk) {
  return {test::memory("r", disk.files[0]), test::memory("w", disk.files[1]),
          test::memory("e", disk.files[2])};
}

struct Written {
  bool created = false;
  bool finished = false;  // without loss
  std::uint64_t given = 0;
  std::uint64_t written = 0;
  std::uint64_t lost = 0;
};

// In batches of `batch` rounds; 0: each block by itself.
Written write_session(Disk& disk, int batch = 0) {
  Written result;
  auto writer = TapeWriter::on_sinks(sinks_on(disk), {"device", "driver"}, {.sync = false});
  if (!writer) return result;
  result.created = true;
  std::int64_t us = 0;
  const auto give = [&](bool read, std::string_view data) {
    us += 100;
    result.given += data.size();
    read ? writer->read_block(tape_time_us(us), as_bytes(data))
         : writer->write_block(tape_time_us(us), as_bytes(data));
  };
  writer->event(tape_time_us(0), event::Open{});
  for (int i = 0; i < 4; ++i) {
    if (batch > 0 && i % batch == 0) {
      writer->commit();
      writer->begin_batch();
    }
    give(false, "question");
    give(true, "the answer to it");
    writer->event(tape_time_us(us), event::Mark{"round"});
    give(true, "!");
  }
  writer->event(tape_time_us(us), event::Close{});
  result.finished = writer->finish(tape_time_us(us)).has_value();
  result.written = writer->bytes_written();
  result.lost = writer->bytes_lost();
  return result;
}

void expect_sound(const Disk& disk, const Written& result, const std::string& what) {
  const auto summary = summarize("t", sources_on(disk));
  ASSERT_TRUE(summary) << what << ": " << summary.error().message;
  EXPECT_TRUE(summary->damages().empty()) << what;
  EXPECT_EQ(summary->read.bytes + summary->write.bytes, result.written) << what;
  EXPECT_EQ(result.written + result.lost, result.given) << what;
}

// However long the disk fails, and whatever is written first when it works again.
TEST(FailingDisk, WhatIsLostIsToldByGapsOnceWritingWorksAgain) {
  for (const int batch : {0, 2}) {
    Disk good;
    ASSERT_TRUE(write_session(good, batch).finished);
    for (int first = 1; first < good.operation - 4; ++first) {
      for (int last = first; last < good.operation - 4; ++last) {
        Disk disk{.first_bad = first, .last_bad = last, .truncate_fails = false};
        const Written result = write_session(disk, batch);
        const auto summary = summarize("t", sources_on(disk));
        const std::string what = fmt::format("operations {} to {}, batches of {}", first, last, batch);
        ASSERT_TRUE(result.created && summary) << what;
        EXPECT_FALSE(result.finished) << what;
        EXPECT_TRUE(summary->events.ended) << what;
        EXPECT_EQ(summary->events.gap_bytes, result.lost) << what;
        EXPECT_GT(summary->events.count<event::Gap>(), 0U) << what;
      }
    }
  }
}

TEST(FailingDisk, AnyOneFailureLeavesASoundTapeAndACountedLoss) {
  Disk good;
  ASSERT_TRUE(write_session(good).finished);
  for (int n = 0; n < good.operation; ++n) {
    for (const std::size_t torn : {0U, 1U, 12U, 13U}) {
      Disk disk{.first_bad = n, .last_bad = n, .torn = torn};
      const Written result = write_session(disk);
      EXPECT_EQ(result.created, n > 0);
      if (!result.created) continue;
      const std::string what = "operation " + std::to_string(n) + ", torn " + std::to_string(torn);
      expect_sound(disk, result, what);
      EXPECT_FALSE(result.finished) << what;
      const auto summary = summarize("t", sources_on(disk));
      EXPECT_TRUE(summary->torn_tails().empty()) << what;
      const bool was_the_last_line = n == good.operation - 1;
      EXPECT_EQ(summary->events.count<event::Gap>(), was_the_last_line ? 0U : 1U) << what;
      EXPECT_EQ(summary->events.gap_bytes, result.lost) << what;
    }
  }
}

TEST(FailingDisk, ABatchKeepsTheWholeBlocksThatFitAndCountsTheRest) {
  for (const int batch : {1, 3, 4}) {
    Disk good;
    ASSERT_TRUE(write_session(good, batch).finished);
    Disk one_by_one;
    ASSERT_TRUE(write_session(one_by_one).finished);
    EXPECT_EQ(good.files[0], one_by_one.files[0]);
    EXPECT_EQ(good.files[1], one_by_one.files[1]);
    for (int n = 1; n < good.operation; ++n) {
      for (const std::size_t torn : {0U, 1U, 20U, 21U, 40U, 60U, 500U}) {
        Disk disk{.first_bad = n, .last_bad = n, .torn = torn};
        const Written result = write_session(disk, batch);
        const std::string what = "batches of " + std::to_string(batch) + ", operation " + std::to_string(n) +
                                 ", torn " + std::to_string(torn);
        expect_sound(disk, result, what);
        EXPECT_FALSE(result.finished) << what;
        const auto summary = summarize("t", sources_on(disk));
        EXPECT_TRUE(summary->torn_tails().empty()) << what;
        if (n < good.operation - 1) {
          EXPECT_EQ(summary->events.gap_bytes, result.lost) << what;
        }
      }
    }
  }
}

TEST(FailingDisk, WhatIsLostBeforeTheDiskIsAGapWhereItWas) {
  Disk disk;
  auto writer = TapeWriter::on_sinks(sinks_on(disk), {"device", "driver"}, {.sync = false});
  ASSERT_TRUE(writer);
  writer->begin_batch();
  writer->read_block(tape_time_us(10), as_bytes("kept"));
  writer->lose(tape_time_us(20), 7, "the queue was full");
  writer->write_block(tape_time_us(40), as_bytes("back again"));
  writer->commit();
  EXPECT_FALSE(writer->finish(tape_time_us(50)));
  auto reader = TapeReader::from_sources(sources_on(disk));
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 10 kept", "gap 40", "w 40 back again", "end 50"));
  EXPECT_THAT(std::string(as_text(disk.files[2])),
              HasSubstr(R"({"t_us":40,"event":"gap","bytes":7,"from_us":20,"why":"the queue was full"})"));
}

TEST(FailingDisk, AFailingTruncationIsTriedAgainBeforeAnythingIsWritten) {
  Disk good;
  ASSERT_TRUE(write_session(good).finished);
  for (int first = 1; first < good.operation; ++first) {
    for (int last = first; last < good.operation + 10; ++last) {
      Disk disk{.first_bad = first, .last_bad = last, .torn = 5};
      const Written result = write_session(disk);
      ASSERT_TRUE(result.created);
      const std::string what = "operations " + std::to_string(first) + " to " + std::to_string(last);
      expect_sound(disk, result, what);
    }
  }
}

TEST(FailingDisk, ADiskThatStaysFullKeepsWhatWasWritten) {
  Disk disk{.first_bad = 4, .last_bad = 1'000'000, .truncate_fails = false, .torn = 3};
  const Written result = write_session(disk);
  expect_sound(disk, result, "full");
  EXPECT_FALSE(result.finished);
  EXPECT_EQ(result.written, 24U);  // the first question and its answer
}

TEST(FailingDisk, TheGapEventSaysWhatIsMissingAndStandsWhereItWas) {
  Disk disk{.truncate_fails = false, .torn = 7};
  auto writer = TapeWriter::on_sinks(sinks_on(disk), {"device", "driver"}, {.sync = false});
  ASSERT_TRUE(writer);
  writer->read_block(tape_time_us(10), as_bytes("kept"));
  disk.first_bad = disk.operation;
  disk.last_bad = disk.operation + 1;
  EXPECT_FALSE(writer->failing());
  writer->read_block(tape_time_us(20), as_bytes("lost"));
  EXPECT_TRUE(writer->failing());
  EXPECT_EQ(writer->failure(), "No space left on device");
  writer->write_block(tape_time_us(30), as_bytes("too"));
  writer->write_block(tape_time_us(40), as_bytes("back again"));
  EXPECT_FALSE(writer->failing());
  EXPECT_EQ(writer->failure(), "");
  EXPECT_EQ(writer->bytes_lost(), 7U);
  const auto finished = writer->finish(tape_time_us(50));
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().code, Errc::io);
  EXPECT_THAT(finished.error().message,
              HasSubstr("7 bytes and 0 events are missing from the tape: No space left"));

  auto reader = TapeReader::from_sources(sources_on(disk));
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 10 kept", "gap 40", "w 40 back again", "end 50"));
  EXPECT_THAT(
      std::string(as_text(disk.files[2])),
      HasSubstr(R"({"t_us":40,"event":"gap","bytes":7,"from_us":20,"why":"No space left on device"})"));
}

TEST(FailingDisk, AHeaderThatCannotBeWrittenIsAnError) {
  Disk disk{.first_bad = 0, .last_bad = 0};
  const auto writer = TapeWriter::on_sinks(sinks_on(disk), {"device", "driver"}, {.sync = false});
  ASSERT_FALSE(writer);
  EXPECT_EQ(writer.error().code, Errc::io);
}

class SyncedSink final : public TapeSink {
 public:
  explicit SyncedSink(int error) : error_(error) {}
  Appended append(ByteView head, ByteView body) override { return {head.size() + body.size(), 0}; }
  int truncate(std::uint64_t) override { return 0; }
  Sync syncer() override {
    return [error = error_] { return error; };
  }
  int close() override { return 0; }

 private:
  int error_;
};

TEST(FailingDisk, AFailedSyncIsToldAtTheEnd) {
  for (const bool sync : {false, true}) {
    auto writer = TapeWriter::on_sinks(
        {std::make_unique<SyncedSink>(EIO), std::make_unique<SyncedSink>(0), std::make_unique<SyncedSink>(0)},
        {"device", "driver"}, {.sync = sync});
    ASSERT_TRUE(writer);
    EXPECT_EQ(writer->finish(tape_time_us(1)).has_value(), !sync);
  }
}

TEST(FailingDisk, FilesThatLoseTheirNamesAreNoTape) {
  const test::TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  auto writer = TapeWriter::create(paths, {"device", "driver"}, {});
  ASSERT_TRUE(writer);
  EXPECT_EQ(writer->syncers()[0](), 0);
  std::filesystem::remove(paths.read);
  EXPECT_EQ(writer->syncers()[0](), ENOENT);
  EXPECT_FALSE(writer->finish(tape_time_us(1)));
}

// Files may not grow over a size while this lives.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    signal_ = std::signal(SIGXFSZ, SIG_IGN);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, signal_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
  void (*signal_)(int) = nullptr;
};

TEST(FailingDisk, RealFilesThatCannotGrowStaySoundAndGoOnLater) {
  const test::TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  auto writer = TapeWriter::create(paths, {"device", "driver"}, {});
  ASSERT_TRUE(writer);
  const std::string data(1000, 'x');
  {
    const FileSizeLimit limit(3500);
    for (int i = 0; i < 5; ++i) writer->read_block(tape_time_us(i * 10), as_bytes(data));
    EXPECT_EQ(writer->failure(), "File too large");
    EXPECT_EQ(test::read_file(paths.read).size(), 3U * 1012);
  }
  writer->read_block(tape_time_us(100), as_bytes(data));
  EXPECT_FALSE(writer->failing());
  EXPECT_FALSE(writer->finish(tape_time_us(200)));
  const auto summary = summarize(paths);
  ASSERT_TRUE(summary);
  EXPECT_TRUE(summary->damages().empty());
  EXPECT_EQ(summary->read.blocks, 4U);
  EXPECT_EQ(summary->events.gap_bytes, 2000U);
}

}  // namespace
}  // namespace porttape
