#include "libport/tty/pty_port.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <functional>
#include <memory>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/loop/sampler.hpp"
#include "libport/tty/pty.hpp"
#include "libport/tty/tty.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/support/time_bound.hpp"
#include "tests/tty/pty_rig.hpp"

namespace porttape {
namespace {

TEST_F(PtyPortTest, IsUpWhileADriverHasItOpen) {
  start();
  UniqueFd fd = driver();
  until("up ");
  fd.reset();
  until("up closed ");
  fd = driver();
  until("up closed up ");
}

TEST_F(PtyPortTest, OfOneThatIsMadeWellNothingIsWarned) {
  start();
  EXPECT_EQ(book.text().find("[warning]"), std::string::npos) << book.text();
}

TEST_F(PtyPortTest, BytesGoBothWaysUnchanged) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  const std::string all = {'\0', '\x03', '\r', '\n', '\x11', '\x13', '\x7f', '\xff'};
  ASSERT_EQ(::write(fd.get(), all.data(), all.size()), static_cast<ssize_t>(all.size()));
  run_until(loop, [&] { return log.data.size() >= all.size(); });
  EXPECT_EQ(log.data, all);
  port.write(as_bytes(all));
  EXPECT_EQ(read_all(fd, all.size()), all);
}

TEST_F(PtyPortTest, ASessionThatIsOverBeforeWeLookIsSeenWhole) {
  start();
  UniqueFd fd = driver();
  ASSERT_EQ(::write(fd.get(), "gone", 4), 4);
  fd.reset();
  until("up closed ");
  EXPECT_EQ(log.data, "gone");
}

TEST_F(PtyPortTest, AnOpenAndCloseWithoutABytesIsSeen) {
  start();
  driver().reset();
  until("up closed ");
}

TEST_F(PtyPortTest, ManyShortSessionsAreSeenOneByOne) {
  start();
  std::string expected;
  for (int i = 0; i < 20; ++i) {
    UniqueFd fd = driver();
    ASSERT_EQ(::write(fd.get(), "x", 1), 1);
    fd.reset();
    expected += "up closed ";
    until(expected);
  }
  EXPECT_EQ(log.data, std::string(20, 'x'));
}

TEST_F(PtyPortTest, WhatADriverLeftUnreadIsNotServedToTheNext) {
  start();
  UniqueFd fd = driver();
  until("up ");
  port.write(as_bytes("stale"));
  fd.reset();
  until("up closed ");
  EXPECT_EQ(log.left_unread, 5U);
  fd = driver();
  until("up closed up ");
  port.write(as_bytes("fresh"));
  EXPECT_EQ(read_all(fd, 5), "fresh");
}

TEST_F(PtyPortTest, WhatADriverLeftUnreadIsCountedToTheLastByte) {
  start();
  UniqueFd fd = driver();
  until("up ");
  const std::string much(12'000, 'x');
  port.write(as_bytes(much));
  fd.reset();
  run_until(loop,
            [&] { return log.events.ends_with("closed "); });  // some may have gone to the kernel before
  EXPECT_EQ(log.left_unread, much.size());
}

void ask_for_lines(const UniqueFd& fd) {
  termios tio{};
  ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
  tio.c_lflag |= ICANON;
  ASSERT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
}

TEST_F(PtyPortTest, WhatADriverLeftUnreadIsSeenThoughItAskedForLinesAndNoneIsWhole) {
  start();
  UniqueFd fd = driver();
  until("up ");
  ask_for_lines(fd);
  port.write(as_bytes("no end"));
  fd.reset();
  until("up closed ");
  EXPECT_EQ(log.left_unread, 6U);
}

TEST_F(PtyPortTest, AHangUpTellsWhatADriverThatAskedForLinesCannotRead) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  ask_for_lines(fd);
  port.write(as_bytes("no end"));
  port.hang_up(true);
  until("up hung_up ");
  EXPECT_EQ(log.left_unread, 6U);
}

TEST_F(PtyPortTest, ADriverThatHasReadAllLeftNothingUnread) {
  start();
  UniqueFd fd = driver();
  until("up ");
  port.write(as_bytes("answer"));
  EXPECT_EQ(read_all(fd, 6), "answer");
  fd.reset();
  until("up closed ");
  EXPECT_EQ(log.left_unread, 0U);
}

TEST_F(PtyPortTest, WhatADriverLeftUnreadIsNotServedToOneThatOpensBeforeWeLook) {
  start();
  UniqueFd fd = driver();
  until("up ");
  port.write(as_bytes("stale"));
  fd.reset();
  fd = driver();
  until("up closed up ");
  EXPECT_EQ(log.left_unread, 5U);
  port.write(as_bytes("fresh"));
  EXPECT_EQ(read_all(fd, 5), "fresh");
}

TEST_F(PtyPortTest, BytesForNobodyDoNotWaitForTheNextDriver) {
  start();
  port.write(as_bytes("early"));
  EXPECT_EQ(log.dropped, 5U);
  const UniqueFd fd = driver();
  until("up ");
  port.write(as_bytes("fresh"));
  EXPECT_EQ(read_all(fd, 5), "fresh");
}

TEST_F(PtyPortTest, AProgramMayOpenItForReadingOrForWritingOnly) {
  start();
  UniqueFd reader = driver(O_RDONLY | O_NOCTTY | O_NONBLOCK);
  until("up ");
  port.write(as_bytes("hello"));
  EXPECT_EQ(read_all(reader, 5), "hello");
  reader.reset();
  until("up closed ");
  UniqueFd writer = driver(O_WRONLY | O_NOCTTY | O_NONBLOCK);
  until("up closed up ");
  ASSERT_EQ(::write(writer.get(), "ask", 3), 3);
  run_until(loop, [&] { return log.data == "ask"; });
  writer.reset();
  until("up closed up closed ");
}

// As `cat port & echo ask > port`.
TEST_F(PtyPortTest, AReaderAndAWriterAreOneSessionUntilTheLastCloses) {
  start();
  UniqueFd reader = driver(O_RDONLY | O_NOCTTY | O_NONBLOCK);
  until("up ");
  for (int n = 1; n <= 3; ++n) {
    UniqueFd writer = driver(O_WRONLY | O_NOCTTY | O_NONBLOCK);
    ASSERT_EQ(::write(writer.get(), "ask", 3), 3);
    writer.reset();
    run_until(loop, [&] { return log.data.size() == static_cast<std::size_t>(3 * n); });
    port.write(as_bytes("got"));
    EXPECT_EQ(read_all(reader, 3), "got");
  }
  EXPECT_EQ(log.events, "up ");
  reader.reset();
  until("up closed ");
}

TEST_F(PtyPortTest, DriversThatLockItMeetEachOtherAndNotUs) {
  start();
  UniqueFd one = driver();
  ASSERT_EQ(::flock(one.get(), LOCK_EX | LOCK_NB), 0);
  UniqueFd two = driver();
  EXPECT_NE(::flock(two.get(), LOCK_EX | LOCK_NB), 0);
  until("up ");
  one.reset();
  EXPECT_EQ(::flock(two.get(), LOCK_EX | LOCK_NB), 0);
  two.reset();
  until("up closed ");
  one = driver();
  EXPECT_EQ(::flock(one.get(), LOCK_EX | LOCK_NB), 0);
  until("up closed up ");
}

TEST_F(PtyPortTest, ADriverThatOutlivesUsSeesAnUnpluggedLineAndFindsTheNextOneByItsName) {
  auto first = std::make_unique<PtyPort>(PortContext{&loop, book.log()}, options());
  first->listen(log);
  ASSERT_TRUE(first->prepare().has_value());
  first->open();
  UniqueFd fd = driver();
  until("up ");
  first.reset();
  pollfd state{fd.get(), POLLIN, 0};
  EXPECT_EQ(::poll(&state, 1, 10'000), 1);
  EXPECT_NE(state.revents & POLLHUP, 0);
  char byte = 0;
  EXPECT_EQ(::read(fd.get(), &byte, 1), 0);
  EXPECT_EQ(::write(fd.get(), "x", 1), -1);
  EXPECT_EQ(errno, EIO);
  termios tio{};
  EXPECT_NE(::tcgetattr(fd.get(), &tio), 0);
  EXPECT_FALSE(driver()) << "the name is gone with it";
  start();
  log.events.clear();
  const UniqueFd again = driver();
  until("up ");
  port.write(as_bytes("fresh"));
  EXPECT_EQ(read_all(again, 5), "fresh");
  EXPECT_EQ(::read(fd.get(), &byte, 1), 0) << "the dead one stays dead";
}

TEST_F(PtyPortTest, ExclusiveUseEndsWithTheDriver) {
  start();
  UniqueFd fd = driver();
  ASSERT_EQ(::ioctl(fd.get(), TIOCEXCL), 0);
  until("up ");
  fd.reset();
  until("up closed ");
  fd = driver();
  ASSERT_TRUE(fd);
  int exclusive = 0;
  ASSERT_EQ(::ioctl(fd.get(), TIOCGEXCL, &exclusive), 0);
  EXPECT_EQ(exclusive, 0);
}

TEST_F(PtyPortTest, IsRawForEachDriverWhateverTheLastOneSet) {
  start();
  UniqueFd fd = driver();
  until("up ");
  termios tio{};
  ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
  EXPECT_EQ(tio.c_lflag & static_cast<tcflag_t>(ICANON | ECHO | ISIG), 0U);
  tio.c_lflag |= ICANON | ECHO;
  ASSERT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
  fd.reset();
  until("up closed ");
  fd = driver();
  ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
  EXPECT_EQ(tio.c_lflag & static_cast<tcflag_t>(ICANON | ECHO | ISIG), 0U);
}

// What a driver turns on is its own affair; nothing that the port set itself may echo.
TEST_F(PtyPortTest, NothingIsEchoedToTheDeviceWhereADriverAsksForLinesAndNoEcho) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  termios tio{};
  ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
  EXPECT_EQ(tio.c_lflag & static_cast<tcflag_t>(ECHO | ECHOE | ECHOK | ECHONL), 0U);
  std::string written;
  for (const tcflag_t flags : {tcflag_t{ICANON}, tcflag_t{ICANON | IEXTEN}, tcflag_t{ICANON | ISIG}}) {
    tio.c_lflag = (tio.c_lflag & ~static_cast<tcflag_t>(ECHO | IEXTEN | ISIG)) | flags;
    ASSERT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
    port.write(as_bytes("one\ntwo\n"));
    EXPECT_EQ(read_all(fd, 4), "one\n");
    EXPECT_EQ(read_all(fd, 4), "two\n");
    ASSERT_EQ(::write(fd.get(), ".", 1), 1);
    written += '.';
    run_until(loop, [&] { return log.data.size() >= written.size(); });
    EXPECT_EQ(log.data, written);
  }
}

TEST_F(PtyPortTest, AskingForParityTwiceIsNoError) {
  start();
  for (int i = 0; i < 3; ++i) {
    UniqueFd fd = driver();
    termios tio{};
    ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
    ::cfmakeraw(&tio);
    tio.c_cflag |= PARENB;
    EXPECT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0) << "session " << i;
    run_until(loop, [&] { return log.events.ends_with("up "); });
    fd.reset();
    run_until(loop, [&] { return log.events.ends_with("closed "); });
  }
}

TEST_F(PtyPortTest, AskingForParityAgainInOneSessionIsNoErrorOnceWeHaveLooked) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  termios tio{};
  for (const tcflag_t parity : {tcflag_t{PARENB}, tcflag_t{PARENB | PARODD}, tcflag_t{PARENB}}) {
    ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
    tio.c_cflag |= CLOCAL | parity;
    EXPECT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
    run_until(loop, [&] {
      return ::tcgetattr(fd.get(), &tio) == 0 && (tio.c_cflag & static_cast<tcflag_t>(CLOCAL)) == 0;
    });
  }
}

TEST_F(PtyPortTest, SoItIsForADriverThatLeavesClocalAlone) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  termios tio{};
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
    tio.c_iflag &= ~static_cast<tcflag_t>(IGNBRK);
    tio.c_cflag |= PARENB;
    EXPECT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
    run_until(loop, [&] {
      return ::tcgetattr(fd.get(), &tio) == 0 && (tio.c_iflag & static_cast<tcflag_t>(IGNBRK)) != 0;
    });
  }
}

// As pyserial does: it flushes after it has set its line, and may set it again at once.
TEST_F(PtyPortTest, AskingForParityAgainAfterAFlushIsNoErrorThoughTheLoopIsBusy) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  termios tio{};
  ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
  tio.c_cflag |= CLOCAL | PARENB;
  EXPECT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
  ASSERT_EQ(::tcflush(fd.get(), TCIFLUSH), 0);
  // The loop does not run: this is done beside it.
  do {
    ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
  } while ((tio.c_cflag & static_cast<tcflag_t>(CLOCAL)) != 0);
  tio.c_cflag |= CLOCAL | PARENB;
  EXPECT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
}

TEST_F(PtyPortTest, ADriverThatDoesNotReadCongestsAndDrains) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  const std::string block(4096, 'b');
  std::size_t written = 0;
  while (!port.congested()) {
    port.write(as_bytes(block));
    written += block.size();
    ASSERT_LT(written, 1U << 20U);
  }
  const Reader reader(loop, fd.get());
  until("up drained ");
  run_until(loop, [&] { return reader.got.size() >= written; });
  EXPECT_EQ(reader.got.size(), written);
}

TEST_F(PtyPortTest, HangUpEndsTheDriversLineAndTheLinkLivesOn) {
  start();
  const UniqueFd fd = driver(O_RDWR | O_NOCTTY);
  until("up ");
  port.hang_up(false);
  until("up hung_up ");
  char byte = 0;
  EXPECT_EQ(::read(fd.get(), &byte, 1), 0);
  const UniqueFd again = driver();
  EXPECT_TRUE(again);
  until("up hung_up up ");
}

TEST_F(PtyPortTest, AtTheEndADriverThatNothingToldOfIsFound) {
  loop.file_events().refuse();  // opens are looked for now and then
  start();
  UniqueFd fd = driver();
  ASSERT_EQ(::write(fd.get(), "quick", 5), 5);
  fd.reset();
  port.read_pending();
  EXPECT_EQ(log.data, "quick");
  EXPECT_EQ(log.events.substr(0, 3), "up ");
}

TEST_F(PtyPortTest, AHangUpTellsWhatItTookAway) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  port.set_reading(false);
  const std::string lost(3000, 'l');
  ASSERT_EQ(::write(fd.get(), lost.data(), lost.size()), 3000);
  port.hang_up(false);
  EXPECT_EQ(log.dropped, 3000U);
  until("up hung_up ");
}

TEST_F(PtyPortTest, BetweenCloseAndOpenAPeersBytesWait) {
  start();
  UniqueFd first = driver();
  until("up ");
  first.reset();
  until("up closed ");
  port.close();
  const UniqueFd second = driver();
  ASSERT_EQ(::write(second.get(), "early", 5), 5);
  while (loop.poll_one()) {
  }
  loop.restart();
  EXPECT_EQ(log.data, "");
  port.open();
  run_until(loop, [&] { return log.data == "early"; });
  EXPECT_EQ(log.events, "up closed up ");
}

TEST_F(PtyPortTest, ANewPtyThatCannotBeMadeIsTriedAgain) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  start();
  const UniqueFd first = driver();
  until("up ");
  {
    const test::NoDescriptors none(unsanitized);
    port.hang_up(false);
    until("up hung_up ");
    run_until(loop, [&] { return book.text().find("is dead until") != std::string::npos; });
  }
  EXPECT_NE(book.text().find("is dead until"), std::string::npos) << book.text();
  const auto opens = [this] { return static_cast<bool>(driver()); };
  run_until(loop, opens);
  EXPECT_TRUE(opens());
}

TEST_F(PtyPortTest, AHangUpNeedsNoMoreDescriptorsThanThePtyHad) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  start();
  const UniqueFd fd = driver();
  until("up ");
  std::filesystem::path pty = std::filesystem::read_symlink(link);
  {
    const test::FewDescriptors few(unsanitized, 1);  // making a pty takes two for a moment
    port.hang_up(false);
    until("up hung_up ");
    run_until(loop, [&] { return std::filesystem::read_symlink(link) != pty; });
  }
  EXPECT_NE(std::filesystem::read_symlink(link), pty);
  EXPECT_EQ(book.text().find("is dead until"), std::string::npos) << book.text();
}

TEST_F(PtyPortTest, HangUpAfterReadingLosesNothing) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  const std::string tail(10'000, 't');
  port.write(as_bytes(tail));
  port.hang_up(true);
  const Reader reader(loop, fd.get());
  until("up hung_up ");
  EXPECT_EQ(reader.got, tail);
}

TEST_F(PtyPortTest, AtTheEndAllThatTheDriverDidNotReadIsCounted) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  const std::string tail(10'000, 't');
  port.write(as_bytes(tail));
  EXPECT_GT(port.unread_by_peer(), 0U);
  port.close();
  EXPECT_EQ(log.dropped + *port.unread_by_peer(), tail.size());
}

TEST_F(PtyPortTest, BackpressureLeavesTheBytesWithTheDriver) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  port.set_reading(false);
  ASSERT_EQ(::write(fd.get(), "later", 5), 5);
  while (loop.poll_one()) {
  }
  EXPECT_EQ(log.data, "");
  port.set_reading(true);
  run_until(loop, [&] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "later");
}

TEST_F(PtyPortTest, ADriverThatFlushesItsInputDropsWhatWeQueued) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  while (!port.congested()) port.write(as_bytes(std::string(4096, 'q')));
  ASSERT_EQ(::tcflush(fd.get(), TCIFLUSH), 0);
  until("up drained ");
  EXPECT_FALSE(port.congested());
}

// The kernel drops what the line discipline has, and goes on with what that had no room for.
TEST_F(PtyPortTest, ADriverThatFlushesWithNewSettingsDropsWhatHadNoRoomToo) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  port.write(as_bytes(std::string(2 * 4095, 'q')));
  EXPECT_FALSE(port.congested());
  pollfd line{fd.get(), POLLIN, 0};
  ASSERT_EQ(::poll(&line, 1, -1), 1);
  termios same{};
  ASSERT_EQ(::tcgetattr(fd.get(), &same), 0);
  ASSERT_EQ(::tcsetattr(fd.get(), TCSAFLUSH, &same), 0);
  until("up flush_in ");
  EXPECT_EQ(::poll(&line, 1, 0), 0);
}

TEST_F(PtyPortTest, WhatIsReadAtTheEndIsBehindAFlushToo) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  ASSERT_EQ(::tcflush(fd.get(), TCIFLUSH), 0);
  ASSERT_EQ(::write(fd.get(), "last", 4), 4);
  port.read_pending();
  EXPECT_EQ(log.events, "up flush_in ");
  EXPECT_EQ(log.data, "last");
}

TEST_F(PtyPortTest, ADriverThatGoesOnWritingDoesNotHoldUpTheEnd) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  constexpr std::size_t kEnough = std::size_t{1} << 20;
  const std::string block(1000, 'w');
  log.on_bytes = [&] {
    if (log.data.size() < kEnough) (void)!::write(fd.get(), block.data(), block.size());
  };
  log.on_bytes();
  port.read_pending();
  EXPECT_GE(log.data.size(), std::size_t{64} << 10) << "as much as a pty can hold";
  EXPECT_LT(log.data.size(), kEnough);
}

TEST_F(PtyPortTest, AFlushOfTheDriversIsTold) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  ASSERT_EQ(::tcflush(fd.get(), TCIFLUSH), 0);
  until("up flush_in ");
  ASSERT_EQ(::tcflush(fd.get(), TCOFLUSH), 0);
  until("up flush_in flush_out ");
}

TEST_F(PtyPortTest, OneOfTwoDescriptorsThatIsClosedAndOpenedAgainIsNoReopen) {
  start();
  const UniqueFd kept = driver();
  UniqueFd other = driver();
  until("up ");
  for (int i = 0; i < 5; ++i) {
    other.reset();
    other = driver();
    ASSERT_EQ(::write(other.get(), "x", 1), 1);
    run_until(loop, [&] { return log.data.size() == static_cast<std::size_t>(i) + 1; });
  }
  EXPECT_EQ(log.events, "up ");
}

TEST_F(PtyPortTest, AReopenBeforeWeLookIsSeenHoweverManyHaveHadItOpen) {
  start();
  UniqueFd one = driver();
  UniqueFd two = driver();
  UniqueFd three = driver();
  until("up ");
  two.reset();
  three.reset();
  one.reset();
  one = driver();
  until("up closed up ");
}

TEST_F(PtyPortTest, WithoutInotifySessionsAreFoundByLooking) {
  loop.file_events().refuse();
  start();
  EXPECT_NE(book.text().find("inotify"), std::string::npos) << book.text();
  UniqueFd fd = driver();
  until("up ");
  UniqueFd other = driver();
  fd.reset();
  fd = driver();  // may have been a reopen: it is not taken for one
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  run_until(loop, [&] { return log.data == "x"; });
  EXPECT_EQ(log.events, "up ");
  fd.reset();
  other.reset();
  until("up closed ");
}

TEST_F(PtyPortTest, TheEndOfADriverThatIsNotReadIsSeenBehindWhatItLeft) {
  start();
  UniqueFd fd = driver();
  until("up ");
  port.set_reading(false);
  ASSERT_EQ(::write(fd.get(), "rest", 4), 4);
  fd.reset();
  until("up closed ");
  EXPECT_EQ(log.data, "");
  EXPECT_EQ(log.dropped, 4U);
  port.set_reading(true);
  fd = driver();
  until("up closed up ");
}

TEST_F(PtyPortTest, TheEndOfADriverThatIsNotReadAndLeftNothingIsSeenAtOnce) {
  start();
  log.wanted = true;
  for (const std::string expected : {"up closed ", "up closed up closed "}) {
    UniqueFd fd = driver();
    run_until(loop, [&] { return log.events.ends_with("up "); });
    port.set_reading(false);
    const Instant begin = loop.now();
    fd.reset();
    until(expected);
    EXPECT_WITHIN(loop.now() - begin, std::chrono::seconds(9))
        << "nothing is kept for a device that may come";
    port.set_reading(true);
  }
}

TEST_F(PtyPortTest, ADriverThatIsNotReadAndOpensAgainIsAnotherSession) {
  start();
  log.wanted = true;
  UniqueFd fd = driver();
  until("up ");
  port.set_reading(false);
  ASSERT_EQ(::write(fd.get(), "rest", 4), 4);
  fd.reset();
  for (int n = 0; n < 50; ++n) loop.poll_one();
  loop.restart();
  fd = driver();
  until("up closed up ");
  ASSERT_EQ(::write(fd.get(), "more", 4), 4);
  for (int n = 0; n < 50; ++n) loop.poll_one();
  loop.restart();
  port.set_reading(true);
  run_until(loop, [&] { return log.data == "restmore"; });
  fd.reset();
  until("up closed up closed ");
}

TEST_F(PtyPortTest, WhileADriverIsNotReadItsFlushesKeepNobodyBusy) {
  start();
  UniqueFd fd = driver();
  until("up ");
  port.set_reading(false);
  loop.sampler().remove(&port);
  const auto handled = [this] {
    while (loop.poll_one()) {
    }
    loop.restart();
    bool over = false;
    Timer limit(loop, [&over] { over = true; });
    limit.set_after(std::chrono::milliseconds(300));
    int count = 0;
    while (!over) {
      loop.run_one();
      ++count;
    }
    return count;
  };
  ASSERT_EQ(::tcflush(fd.get(), TCIOFLUSH), 0);  // which waits to be read
  EXPECT_LE(handled(), 3000) << "some looks, what others do with ptys, and no busy loop";
  fd.reset();
  until("up closed ");
}

TEST_F(PtyPortTest, LostEventsMakeEveryoneLook) {
  start();
  loop.file_events().lose();
  const UniqueFd fd = driver();
  until("up ");
}

// In a child that is not root: what the driver keeps to itself cannot be looked at then.
TEST(PtyPortUnprivileged, ADriverThatKeepsTheLineToItselfGetsTheLastAnswer) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to become somebody who is not";
  const pid_t child = ::fork();
  if (child == 0) {
    if (::setresgid(65534, 65534, 65534) != 0 || ::setresuid(65534, 65534, 65534) != 0) ::_exit(2);
    Loop loop;
    LogBook book;
    PortLog log;
    const UniqueFd out(::open("/dev/null", O_WRONLY));
    ::dup2(out.get(), STDOUT_FILENO);
    PtyPort port(PortContext{&loop, book.log()}, {});
    port.listen(log);
    if (!port.prepare()) ::_exit(3);
    port.open();
    UniqueFd fd(::open(port.name().substr(4).c_str(), O_RDWR | O_NOCTTY));
    if (!fd || ::ioctl(fd.get(), TIOCEXCL) != 0) ::_exit(4);
    run_until(loop, [&] { return log.events == "up "; });
    port.write(as_bytes("the last answer"));
    port.hang_up(true);
    run_until(loop, [&] { return book.text().find("cannot be seen") != std::string::npos; });
    char buffer[64];
    if (::read(fd.get(), buffer, sizeof buffer) != 15) ::_exit(5);
    fd.reset();
    run_until(loop, [&] { return log.events != "up "; });
    const bool told = log.events == "up closed ";
    if (!told) ::_exit(6);
    for (int n = 0; n < 3; ++n) {  // each on a new pty, and that is told once
      fd.reset(::open(port.name().substr(4).c_str(), O_RDWR | O_NOCTTY));
      if (!fd || ::ioctl(fd.get(), TIOCEXCL) != 0) ::_exit(7);
      run_until(loop, [&] { return log.events.ends_with("up "); });
      fd.reset();
      run_until(loop, [&] { return log.events.ends_with("closed "); });
    }
    const std::string text = book.text();
    const std::string news = "a new pty takes its place";
    ::_exit(text.find(news) != std::string::npos && text.find(news) == text.rfind(news) ? 0 : 8);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0) << "exit status " << WEXITSTATUS(status);
}

TEST(PtyPorts, ManyNeedOneInotifyDescriptorAndNoTimerEach) {
  Loop loop;
  LogBook book;
  PortLog log;
  const test::TempDir dir;
  std::vector<std::unique_ptr<PtyPort>> ports;
  for (int i = 0; i < 200; ++i) {
    const std::string link = (dir.path() / std::to_string(i)).string();
    ports.push_back(std::make_unique<PtyPort>(PortContext{&loop, book.log()}, PtyOptions{.link = link}));
    ports.back()->listen(log);
    ASSERT_TRUE(ports.back()->prepare().has_value()) << i;
    ports.back()->open();
  }
  int inotify = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    if (std::filesystem::read_symlink(entry, gone).string().find("inotify") != std::string::npos) ++inotify;
  }
  EXPECT_EQ(inotify, 1);
  const UniqueFd fd(::open((dir.path() / "117").c_str(), O_RDWR | O_NOCTTY));
  run_until(loop, [&] { return log.events == "up "; });
}

TEST(PtyPortOptions, ModeIsTheSlaves) {
  test::TempDir dir;
  Loop loop;
  LogBook book;
  const std::string link = (dir.path() / "port").string();
  PtyPort port(PortContext{&loop, book.log()}, {.link = link, .access = {.mode = 0640}});
  ASSERT_TRUE(port.prepare().has_value());
  EXPECT_EQ(std::filesystem::status(link).permissions(), static_cast<std::filesystem::perms>(0640));
}

TEST(PtyPortOptions, UnknownOwnerAndGroupAreErrors) {
  Loop loop;
  LogBook book;
  for (const Pty::Access& access :
       {Pty::Access{.owner = "nobody-here"}, Pty::Access{.group = "nobody-here"}}) {
    PtyPort port(PortContext{&loop, book.log()}, {.access = access});
    const Result<void> prepared = port.prepare();
    ASSERT_FALSE(prepared.has_value());
    EXPECT_EQ(prepared.error().code, Errc::usage);
    EXPECT_NE(prepared.error().message.find("nobody-here"), std::string::npos);
  }
}

}  // namespace
}  // namespace porttape
