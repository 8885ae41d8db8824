#include "libport/loop/fd_watch.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <memory>
#include <string>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::seconds;

class FdWatchTest : public testing::Test {
 protected:
  void make(int fd) {
    watch = std::make_unique<FdWatch>(
        loop, fd, [this] { called("r"); }, [this] { called("w"); }, [this] { called("h"); });
  }
  // Both ends of a pipe; the end that is read is watched.
  void make_pipe() {
    std::array<int, 2> pipe{};
    ASSERT_EQ(::pipe2(pipe.data(), O_NONBLOCK | O_CLOEXEC), 0);
    read_end.reset(pipe[0]);
    write_end.reset(pipe[1]);
    make(read_end.get());
  }
  void write() const { ASSERT_EQ(::write(write_end.get(), "x", 1), 1); }
  void called(const std::string& what) {
    calls += what;
    char byte = 0;
    if (takes && what == "r") (void)!::read(read_end.get(), &byte, 1);
    if (stops) watch->watch_readable(false), watch->watch_writable(false), watch->watch_hang_up(false);
    if (ends) watch.reset();
  }

  ManualClock clock;
  Loop loop{clock};
  UniqueFd read_end;
  UniqueFd write_end;
  std::unique_ptr<FdWatch> watch;
  std::string calls;
  bool takes = true;   // a callback takes a byte,
  bool stops = false;  // switches all off,
  bool ends = false;   // destroys the watch
};

TEST_F(FdWatchTest, WhatCanBeReadIsTold) {
  make_pipe();
  watch->watch_readable(true);
  settle(loop);
  EXPECT_EQ(calls, "");
  write();
  settle(loop);
  EXPECT_EQ(calls, "r");
  write();
  settle(loop);
  EXPECT_EQ(calls, "rr") << "and told again";
}

TEST_F(FdWatchTest, TheCallbackComesAgainWhileThereIsMoreToRead) {
  make_pipe();
  for (int n = 0; n < 3; ++n) write();
  watch->watch_readable(true);
  settle(loop);
  EXPECT_EQ(calls, "rrr");
}

// Both can be read. The callback of the first ends the watch of the second; a new watch then has its place,
// and an event is waiting there.
TEST_F(FdWatchTest, ANewWatchIsNotToldOfAnEndedOnesEvents) {
  std::array<UniqueFd, 2> ready;
  std::array<std::unique_ptr<FdWatch>, 2> both;
  for (const std::size_t index : {0U, 1U}) {
    ready[index].reset(::eventfd(1, EFD_NONBLOCK | EFD_CLOEXEC));
    both[index] = std::make_unique<FdWatch>(loop, ready[index].get(), [&, index] {
      both[index]->watch_readable(false);
      if (watch) return;
      both[1 - index].reset();
      make_pipe();
      watch->watch_readable(true);
      watch->watch_hang_up(true);
    });
    both[index]->watch_readable(true);
  }
  settle(loop);
  ASSERT_NE(watch, nullptr);
  EXPECT_EQ(calls, "");
  write();
  settle(loop);
  EXPECT_EQ(calls, "r");
}

TEST_F(FdWatchTest, OneThatIsSwitchedOnTwiceIsCalledOnce) {
  make_pipe();
  watch->watch_readable(true);
  watch->watch_readable(true);
  write();
  settle(loop);
  EXPECT_EQ(calls, "r");
}

TEST_F(FdWatchTest, OneThatIsSwitchedOffIsNotCalled) {
  make_pipe();
  watch->watch_readable(true);
  settle(loop);
  watch->watch_readable(false);
  write();
  settle(loop);
  EXPECT_EQ(calls, "");
  watch->watch_readable(true);
  settle(loop);
  EXPECT_EQ(calls, "r");
}

TEST_F(FdWatchTest, ACallbackMaySwitchItselfOff) {
  make_pipe();
  takes = false;
  stops = true;
  write();
  watch->watch_readable(true);
  settle(loop);
  EXPECT_EQ(calls, "r");
}

TEST_F(FdWatchTest, ACallbackMayDestroyTheWatch) {
  make_pipe();
  takes = false;
  ends = true;
  write();
  watch->watch_readable(true);
  settle(loop);
  EXPECT_EQ(calls, "r");
}

TEST_F(FdWatchTest, AStoppedOneIsNotCalledEvenIfItIsSwitchedOn) {
  make_pipe();
  write();
  watch->watch_readable(true);
  watch->stop();
  watch->stop();
  settle(loop);
  watch->watch_readable(true);
  settle(loop);
  EXPECT_EQ(calls, "");
}

TEST_F(FdWatchTest, TheDescriptorIsNotItsOwn) {
  make_pipe();
  watch->watch_readable(true);
  settle(loop);
  watch.reset();
  settle(loop);
  EXPECT_NE(::fcntl(read_end.get(), F_GETFD), -1) << "it is open still";
}

TEST_F(FdWatchTest, AHangUpIsToldWhereNobodyReads) {
  make_pipe();
  stops = true;
  watch->watch_hang_up(true);
  write();
  settle(loop);
  EXPECT_EQ(calls, "") << "bytes are none";
  write_end.reset();
  settle(loop);
  EXPECT_EQ(calls, "h");
}

TEST_F(FdWatchTest, RoomToWriteIsTold) {
  make_pipe();
  stops = true;
  make(write_end.get());
  watch->watch_writable(true);
  settle(loop);
  EXPECT_EQ(calls, "w");
}

// The kernel has no events of a plain file.
class WatchOfAFile : public FdWatchTest {
 protected:
  WatchOfAFile() {
    takes = false;
    make(file.get());
  }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }

  test::TempDir dir;
  UniqueFd file{::open((dir.path() / "file").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600)};
};

TEST_F(WatchOfAFile, LooksEveryTenMilliseconds) {
  watch->watch_readable(true);
  pass(FdWatch::kLook - Nanos(1));
  EXPECT_EQ(calls, "");
  pass(Nanos(1));
  EXPECT_EQ(calls, "r");
  pass(FdWatch::kLook - Nanos(1));
  EXPECT_EQ(calls, "r");
  pass(Nanos(1));
  EXPECT_EQ(calls, "rr");
}

TEST_F(WatchOfAFile, LooksForWhatIsWantedAlone) {
  watch->watch_writable(true);
  pass(FdWatch::kLook);
  EXPECT_EQ(calls, "w");
  watch->watch_readable(true);
  pass(FdWatch::kLook);
  EXPECT_EQ(calls, "wrw");
}

TEST_F(WatchOfAFile, OneMoreWishDoesNotPutTheLookOff) {
  watch->watch_readable(true);
  pass(FdWatch::kLook / 2);
  watch->watch_writable(true);
  pass(FdWatch::kLook / 2);
  EXPECT_EQ(calls, "rw");
}

TEST_F(WatchOfAFile, AFileIsNeverHungUp) {
  watch->watch_hang_up(true);
  pass(seconds(1));
  EXPECT_EQ(calls, "");
}

TEST_F(WatchOfAFile, LooksNoMoreWhereNothingIsWanted) {
  stops = true;
  watch->watch_readable(true);
  pass(seconds(1));
  EXPECT_EQ(calls, "r");
  EXPECT_FALSE(loop.next_timer());
}

TEST_F(WatchOfAFile, WhatACallbackSwitchesOffIsNotCalledInTheSameLook) {
  stops = true;
  watch->watch_readable(true);
  watch->watch_writable(true);
  pass(FdWatch::kLook);
  EXPECT_EQ(calls, "r");
}

TEST_F(WatchOfAFile, ACallbackMayDestroyTheWatchHereToo) {
  ends = true;
  watch->watch_readable(true);
  watch->watch_writable(true);
  pass(seconds(1));
  EXPECT_EQ(calls, "r");
  EXPECT_FALSE(loop.next_timer());
}

TEST_F(WatchOfAFile, AStoppedOneLooksNoMore) {
  watch->watch_readable(true);
  watch->stop();
  EXPECT_FALSE(loop.next_timer());
  watch->watch_readable(true);
  EXPECT_FALSE(loop.next_timer());
  pass(seconds(1));
  EXPECT_EQ(calls, "");
}

// What the kernel does not watch, for lack of room or right, is looked at by the clock.
TEST_F(FdWatchTest, WhatTheKernelRefusesToWatchIsLookedAt) {
  for (const int error : {ENOSPC, ENOMEM, EPERM}) {
    calls.clear();
    EXPECT_TRUE(test::while_refused({{SYS_epoll_ctl, error}}, [&] {
      make_pipe();
      watch->watch_readable(true);
      watch->watch_hang_up(true);
      write();
      (void)let_pass(loop, clock, FdWatch::kLook - Nanos(1));
      EXPECT_EQ(calls, "");
      (void)let_pass(loop, clock, Nanos(1));
      EXPECT_EQ(calls, "r") << error;
    }));
    write();
    (void)let_pass(loop, clock, FdWatch::kLook);
    EXPECT_EQ(calls, "rr") << "and it goes on so";
    (void)let_pass(loop, clock, 3 * FdWatch::kLook);
    EXPECT_EQ(calls, "rr") << "there is no more";
    write_end.reset();
    takes = false;
    (void)let_pass(loop, clock, FdWatch::kLook);
    EXPECT_EQ(calls, "rrrh") << "a hang-up is told to both";
    takes = true;
    watch.reset();
    EXPECT_FALSE(loop.next_timer());
  }
}

#ifdef SYS_poll
TEST_F(FdWatchTest, ALookThatFailsTellsNothing) {
  EXPECT_TRUE(test::while_refused({{SYS_epoll_ctl, EPERM}, {SYS_poll, ENOMEM}}, [&] {
    make_pipe();
    watch->watch_readable(true);
    write();
    (void)let_pass(loop, clock, 3 * FdWatch::kLook);
    EXPECT_EQ(calls, "");
  }));
  (void)let_pass(loop, clock, FdWatch::kLook);
  EXPECT_EQ(calls, "r") << "the next one does";
}
#endif

}  // namespace
}  // namespace porttape
