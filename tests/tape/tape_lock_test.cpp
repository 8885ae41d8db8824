// A tape that is being written belongs to its recorder: nobody takes, moves or replaces it.

#include "libport/tape/tape_lock.hpp"

#include <barrier>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::TempDir;
using testing::HasSubstr;

const TapeHeader kLockedHeader{"device", "driver"};

Result<TapeWriter> create(const TapePaths& paths, OnExisting on_existing, unsigned first_number = 1) {
  return TapeWriter::create(paths, kLockedHeader,
                            {.on_existing = on_existing, .first_number = first_number, .sync = false});
}

std::string id_on_disk(const TapePaths& paths) {
  const auto reader = TapeReader::open(paths);
  return reader && reader->header() ? reader->header()->id.raw() : std::string("no header");
}

std::ptrdiff_t files_in(const TempDir& dir) {
  return std::distance(std::filesystem::directory_iterator(dir.path()), {});
}

TEST(TapeLock, ALiveTapeIsNeitherTakenNorReplaced) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  auto live = create(paths, OnExisting::refuse);
  ASSERT_TRUE(live);
  for (const OnExisting how : {OnExisting::refuse, OnExisting::overwrite}) {
    for (const Error& error :
         {TapeWriter::check(paths, {.on_existing = how}).error(), create(paths, how).error()}) {
      EXPECT_EQ(error.code, Errc::usage);
      EXPECT_THAT(error.message, HasSubstr("t.logr' is being written by another recording"));
      EXPECT_THAT(error.message, HasSubstr("take another name"));
    }
  }
  live->read_block(tape_time_us(1), as_bytes("mine"));
  EXPECT_TRUE(live->finish(tape_time_us(2)));
  EXPECT_EQ(id_on_disk(paths), live->id());
  EXPECT_EQ(files_in(dir), 3);
  EXPECT_TRUE(create(paths, OnExisting::overwrite));
}

TEST(TapeLock, AReadersLockIsNotCalledARecording) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  EXPECT_TRUE(create(paths, OnExisting::refuse)->finish(tape_time_us(2)));
  const UniqueFd reader(::open(paths.write.c_str(), O_RDONLY | O_CLOEXEC));
  struct flock whole {};
  whole.l_type = F_RDLCK;
  whole.l_whence = SEEK_SET;
  ASSERT_EQ(::fcntl(reader.get(), F_OFD_SETLK, &whole), 0);
  const auto refused = create(paths, OnExisting::overwrite);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Errc::usage);
  EXPECT_THAT(refused.error().message, HasSubstr("t.logw' is locked by a program that reads it"));
  EXPECT_THAT(refused.error().message, testing::Not(HasSubstr("being written")));
}

TEST(TapeLock, OneLiveFileOfTheThreeIsEnough) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  auto live = create(paths, OnExisting::refuse);
  ASSERT_TRUE(live);
  std::filesystem::remove(paths.read);
  std::filesystem::remove(paths.write);
  EXPECT_THAT(create(paths, OnExisting::overwrite).error().message, HasSubstr("t.loge' is being written"));
  EXPECT_EQ(files_in(dir), 1);
}

TEST(TapeLock, IsSeenWithoutBeingTaken) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  EXPECT_FALSE(is_being_written(paths));
  auto live = create(paths, OnExisting::refuse);
  ASSERT_TRUE(live);
  EXPECT_TRUE(is_being_written(paths));
  EXPECT_TRUE(is_being_written(paths));
  EXPECT_TRUE(live->finish(tape_time_us(0)));
  EXPECT_FALSE(is_being_written(paths));
}

TEST(TapeLock, OfSeveralWhoOverwriteAtOnceOneHasTheTape) {
  constexpr int kWriters = 4;
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  for (int round = 0; round < 100; ++round) {
    if (round % 3 == 0) {  // from nothing, too
      for (const auto& path : {paths.read, paths.write, paths.events}) std::filesystem::remove(path);
    }
    std::vector<std::optional<TapeWriter>> writers(kWriters);
    std::barrier start(kWriters);
    {
      std::vector<std::jthread> threads;
      for (auto& writer : writers) {
        threads.emplace_back([&] {
          start.arrive_and_wait();
          if (auto made = create(paths, OnExisting::overwrite)) writer = std::move(*made);
        });
      }
    }
    std::string id;
    int made = 0;
    for (const auto& writer : writers) {
      if (!writer) continue;
      ++made;
      id = writer->id();
    }
    ASSERT_EQ(made, 1) << "round " << round;
    ASSERT_EQ(id_on_disk(paths), id) << "round " << round;
    ASSERT_EQ(files_in(dir), 3) << "round " << round;
  }
}

TEST(TapeLock, NextTakesTheFirstFreeName) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  std::ofstream(dir / "t.2.loge") << "somebody's";
  std::filesystem::create_symlink("nowhere", dir / "t.3.logw");
  EXPECT_TRUE(TapeWriter::check(paths, {.on_existing = OnExisting::next}));
  const auto first = create(paths, OnExisting::next);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->paths(), paths);
  const auto second = create(paths, OnExisting::next);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->paths().name(), dir / "t.4.log");
  EXPECT_EQ(id_on_disk(second->paths()), second->id());
}

TEST(TapeLock, NextBeginsWhereItIsToldTo) {
  const TempDir dir;
  const auto part = create(literal_tape(dir / "t.log"), OnExisting::next, 2);
  ASSERT_TRUE(part);
  EXPECT_EQ(part->paths().name(), dir / "t.2.log");
}

TEST(TapeLock, OfSeveralWhoTakeTheNextNameEachHasItsOwn) {
  constexpr int kWriters = 4;
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  std::vector<std::optional<TapeWriter>> writers(kWriters);
  std::barrier start(kWriters);
  {
    std::vector<std::jthread> threads;
    for (auto& writer : writers) {
      threads.emplace_back([&] {
        start.arrive_and_wait();
        if (auto made = create(paths, OnExisting::next)) writer = std::move(*made);
      });
    }
  }
  std::set<std::string> names;
  for (const auto& writer : writers) {
    ASSERT_TRUE(writer);
    names.insert(writer->paths().name());
    EXPECT_EQ(id_on_disk(writer->paths()), writer->id());
  }
  EXPECT_EQ(names.size(), writers.size());
  EXPECT_EQ(files_in(dir), 3 * kWriters);
}

TEST(TapeLock, NextSaysWhyNoNameCanBeMade) {
  const TempDir dir;
  const auto made = create(literal_tape(dir / "no/t.log"), OnExisting::next);
  ASSERT_FALSE(made);
  EXPECT_THAT(made.error().message, HasSubstr("/no"));
}

}  // namespace
}  // namespace porttape
