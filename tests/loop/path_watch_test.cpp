#include "libport/loop/path_watch.hpp"

#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <system_error>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr Nanos kNever = std::chrono::hours(1);  // what comes before was an event

class PathWatchTest : public testing::Test {
 protected:
  void wait_for(const fs::path& path, Nanos first = kNever) {
    watch.emplace(
        loop, path.string(), [this] { ++calls; }, first);
  }
  // The next call, and nothing of what was before.
  void until_called() {
    run_until(loop, [this] { return calls > 0; });
    drain();
    calls = 0;
  }
  void drain() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }
  static void make(const fs::path& path) { std::ofstream(path) << "x"; }

  test::TempDir dir;
  fs::path top = dir.path();
  Loop loop;
  std::optional<PathWatch> watch;
  int calls = 0;
};

TEST_F(PathWatchTest, WhatAppearsIsTold) {
  wait_for(top / "node");
  make(top / "node");
  until_called();
}

TEST_F(PathWatchTest, WhatVanishesIsNotToldUntilItIsBack) {
  make(top / "node");
  wait_for(top / "node");
  fs::remove(top / "node");
  drain();
  EXPECT_EQ(calls, 0);
  make(top / "node");
  until_called();
}

TEST_F(PathWatchTest, AFolderMayVanishAndComeBackTwoLevelsDeep) {
  const fs::path link = top / "serial" / "by-id" / "usb-x";
  make(top / "ttyUSB0");
  fs::create_directories(link.parent_path());
  fs::create_symlink("../../ttyUSB0", link);
  wait_for(link);
  for (int n = 0; n < 3; ++n) {
    fs::remove(top / "ttyUSB0");
    fs::remove_all(top / "serial");
    drain();
    EXPECT_EQ(calls, 0);
    make(top / "ttyUSB1");
    fs::create_directory(top / "serial");
    drain();
    fs::create_directory(top / "serial" / "by-id");
    drain();
    EXPECT_EQ(calls, 0);
    fs::create_symlink("../../ttyUSB1", link);
    until_called();
    fs::remove(top / "ttyUSB1");
    make(top / "ttyUSB0");
    fs::remove(link);
    fs::create_symlink("../../ttyUSB0", link);
    until_called();
  }
}

TEST_F(PathWatchTest, FoldersThatComeAllAtOnceAreFollowed) {
  wait_for(top / "a" / "b" / "c" / "node");
  fs::create_directories(top / "a" / "b" / "c");
  make(top / "a" / "b" / "c" / "node");
  until_called();
}

TEST_F(PathWatchTest, ALinkMayDangleFirst) {
  fs::create_directory(top / "by-id");
  fs::create_symlink("../nodes/tty", top / "by-id" / "x");
  wait_for(top / "by-id" / "x");
  fs::create_directory(top / "nodes");
  drain();
  EXPECT_EQ(calls, 0);
  make(top / "nodes" / "tty");
  until_called();
}

TEST_F(PathWatchTest, ALinkThatIsReplacedByOneToElsewhereIsTold) {
  make(top / "one");
  make(top / "two");
  fs::create_symlink("one", top / "link");
  wait_for(top / "link");
  fs::create_symlink("two", top / "new");
  fs::rename(top / "new", top / "link");
  until_called();
  fs::remove(top / "two");
  drain();
  make(top / "two");  // where it leads now
  until_called();
}

TEST_F(PathWatchTest, AFolderThatIsMovedAwayIsNoWay) {
  fs::create_directory(top / "folder");
  make(top / "folder" / "node");
  wait_for(top / "folder" / "node");
  fs::rename(top / "folder", top / "old");
  drain();
  make(top / "old" / "other");
  fs::remove(top / "old" / "node");
  make(top / "old" / "node");
  drain();
  EXPECT_EQ(calls, 0);
  fs::create_directory(top / "folder");
  make(top / "folder" / "node");
  until_called();
}

TEST_F(PathWatchTest, NewPermissionsAreTold) {
  make(top / "node");
  wait_for(top / "node");
  fs::permissions(top / "node", fs::perms::owner_read);
  until_called();
}

TEST_F(PathWatchTest, LinksThatLeadInACircleLeadNowhere) {
  fs::create_symlink("b", top / "a");
  fs::create_symlink("a", top / "b");
  wait_for(top / "a");
  make(top / "new");
  fs::rename(top / "new", top / "b");
  until_called();
}

TEST_F(PathWatchTest, AWayHasAsManyLinksAsTheKernelFollows) {
  make(top / "0");
  for (int n = 1; n <= 41; ++n) fs::create_symlink(std::to_string(n - 1), top / std::to_string(n));
  wait_for(top / "40");
  EXPECT_TRUE(watch->has_timer()) << "it leads to the file";
  EXPECT_TRUE(fs::exists(top / "40"));
  wait_for(top / "41");
  EXPECT_FALSE(watch->has_timer()) << "it leads nowhere";
  std::error_code error;
  EXPECT_FALSE(fs::exists(top / "41", error));
}

TEST_F(PathWatchTest, WhileNothingIsThereNoTimerRuns) {
  wait_for(top / "folder" / "node", PathWatch::kFirst);
  EXPECT_FALSE(watch->has_timer());
  make(top / "other");  // none of its business
  drain();
  EXPECT_EQ(calls, 0);
  fs::create_directory(top / "folder");
  drain();
  EXPECT_FALSE(watch->has_timer());
  make(top / "folder" / "node");
  until_called();
  EXPECT_TRUE(watch->has_timer()) << "nothing tells when it can be used";
  fs::remove(top / "folder" / "node");
  drain();
  EXPECT_FALSE(watch->has_timer());
}

TEST_F(PathWatchTest, WhatIsThereIsToldAgainAndAgain) {
  make(top / "node");
  const Instant begin = loop.now();
  wait_for(top / "node", std::chrono::milliseconds(10));
  run_until(loop, [this] { return calls == 3; });
  EXPECT_GE(loop.now() - begin, std::chrono::milliseconds(10 + 20 + 40));
}

TEST_F(PathWatchTest, ItIsToldLaterAndLaterUpToTwoSeconds) {
  ManualClock clock;
  Loop slow{clock};
  make(top / "node");
  const PathWatch told(slow, (top / "node").string(), [] {});
  for (const int delay : {100, 200, 400, 800, 1600, 2000, 2000, 2000}) {
    ASSERT_TRUE(slow.next_timer().has_value());
    EXPECT_EQ(*slow.next_timer() - clock.now(), std::chrono::milliseconds(delay));
    let_pass(slow, clock, std::chrono::milliseconds(delay));
  }
}

TEST_F(PathWatchTest, WithoutInotifyItIsLookedFor) {
  loop.file_events().refuse();
  wait_for(top / "folder" / "node", std::chrono::milliseconds(10));
  fs::create_directory(top / "folder");
  make(top / "folder" / "node");
  until_called();
}

TEST_F(PathWatchTest, WhatCameBeforeEventsWereWatchedIsFound) {
  loop.file_events().begin_after(std::chrono::milliseconds(20));
  wait_for(top / "node");
  make(top / "node");
  until_called();
}

TEST_F(PathWatchTest, ItMayEndFromWithinItsCallback) {
  std::unique_ptr<PathWatch> ended;
  ended = std::make_unique<PathWatch>(loop, (top / "node").string(), [&] { ended.reset(); });
  make(top / "node");
  run_until(loop, [&] { return !ended; });
}

}  // namespace
}  // namespace porttape
