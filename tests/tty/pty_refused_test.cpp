// What a pty, and the port that has one, do where a call of the system fails.

#include <asm/termbits.h>  // TCGETS2; not to be mixed with <termios.h>
#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <filesystem>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/loop/loop.hpp"
#include "libport/tty/pty.hpp"
#include "libport/tty/pty_port.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using test::refused_ioctl;
using test::refused_on;
using test::refused_open;
using test::RefusedCall;
using test::while_refused;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing::Not;

class PtyRefused : public testing::Test {
 protected:
  PtyRefused() {
    Result<Pty> made = Pty::create(events, {});
    EXPECT_TRUE(made.has_value()) << made.error().message;
    if (made) pty.emplace(std::move(*made));
  }
  [[nodiscard]] UniqueFd driver() const {
    return UniqueFd(::open(pty->slave_path().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  }
  void send(const std::string& text) const {
    ASSERT_EQ(::write(pty->master(), text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }

  Loop loop;
  FileEvents events{loop};
  std::optional<Pty> pty;
};

TEST_F(PtyRefused, OneWhoseSettingsCannotBeMadeIsNoneAndTheReasonIsTold) {
  const std::pair<RefusedCall, std::string> cases[] = {
      {refused_ioctl(TCGETS2, EIO), "reading the pty's settings: Input/output error"},
      {refused_ioctl(TCSETS2, EPERM), "making the pty raw: Operation not permitted"}};
  for (const auto& [refused, why] : cases) {
    EXPECT_TRUE(while_refused({refused}, [&, why = why] {
      const Result<Pty> other = Pty::create(events, {});
      ASSERT_FALSE(other.has_value()) << why;
      EXPECT_THAT(other.error().message, HasSubstr(why));
    }));
  }
}

TEST_F(PtyRefused, OneThatCannotBeMadeFreshSaysWhichStepFailed) {
  const std::pair<RefusedCall, std::string> cases[] = {
      {refused_ioctl(TIOCPKT, EIO), "pty: packet mode: Input/output error"},
      {refused_ioctl(TCGETS2, EIO), "reading the pty's settings: Input/output error"},
      {{SYS_openat, EMFILE}, "pty: opening /dev/pts/[0-9]+: Too many open files"},
      {{SYS_openat, EBUSY}, "pty: opening /dev/pts/[0-9]+: Device or resource busy"},
      {refused_ioctl(TCFLSH, EIO), "pty: flushing /dev/pts/[0-9]+: Input/output error"},
      {refused_ioctl(TCSETS2, EIO), "making the pty raw: Input/output error"}};
  for (const auto& [refused, why] : cases) {
    driver().reset();
    EXPECT_TRUE(while_refused({refused}, [&, why = why] {
      const Result<void> settled = pty->settle(std::nullopt);
      ASSERT_FALSE(settled.has_value()) << why;
      EXPECT_EQ(settled.error().code, Errc::io) << why;
      EXPECT_THAT(settled.error().message, MatchesRegex(".*" + why));
    }));
    EXPECT_TRUE(pty->settle(std::nullopt).has_value()) << "after " << why;
    (void)pty->take_events();
  }
}

// Without exact events a last close is looked for: that of one's own failure is nobody's visit.
TEST_F(PtyRefused, AFailureIsNoVisit) {
  FileEvents none(loop);
  none.refuse();
  Result<Pty> own = Pty::create(none, {});
  ASSERT_TRUE(own.has_value());
  ASSERT_FALSE(own->exact());
  for (const RefusedCall& refused :
       {refused_ioctl(TCGETS2, EIO), refused_ioctl(TCFLSH, EIO), RefusedCall{SYS_openat, EMFILE}}) {
    UniqueFd(::open(own->slave_path().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC)).reset();
    EXPECT_TRUE(while_refused({refused}, [&] { EXPECT_FALSE(own->settle(std::nullopt).has_value()); }));
    EXPECT_FALSE(own->take_visit());
    UniqueFd(::open(own->slave_path().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC)).reset();
    EXPECT_TRUE(own->take_visit());
  }
}

TEST_F(PtyRefused, AfterAFailureItTellsFlushesAsBefore) {
  for (const RefusedCall& refused :
       {refused_ioctl(TCGETS2, EIO), RefusedCall{SYS_openat, EMFILE}, refused_ioctl(TCFLSH, EIO)}) {
    EXPECT_TRUE(while_refused({refused}, [&] { EXPECT_FALSE(pty->settle(std::nullopt).has_value()); }));
    const UniqueFd fd = driver();
    ASSERT_EQ(::write(fd.get(), "x", 1), 1);
    char packet[16];
    run_until(loop, [&] { return pty->has_input(); });
    ASSERT_EQ(::read(pty->master(), packet, sizeof packet), 2) << "packet mode is on";
    EXPECT_EQ(packet[0], TIOCPKT_DATA);
  }
}

TEST_F(PtyRefused, WhereUnreadInputCannotBeCountedItIsNotGuessed) {
  const UniqueFd fd = driver();
  send("four");
  for (const RefusedCall& refused :
       {RefusedCall{SYS_openat, EBUSY}, RefusedCall{SYS_openat, EMFILE}, refused_ioctl(FIONREAD, EIO)}) {
    EXPECT_TRUE(while_refused({refused}, [&] { EXPECT_EQ(pty->unread(), std::nullopt); }));
  }
  EXPECT_EQ(pty->unread(), 4U);
  EXPECT_TRUE(while_refused({{SYS_openat, EBUSY}},
                            [&] { EXPECT_EQ(pty->read_away(Pty::LineIs::over), std::nullopt); }));
  EXPECT_EQ(pty->unread(), 4U) << "it is all still there";
  EXPECT_EQ(pty->read_away(Pty::LineIs::over), 4U);
  EXPECT_EQ(pty->read_away(Pty::LineIs::over), 0U);
}

TEST_F(PtyRefused, WhatTheLastDriverLeftUnreadIsNotGuessedEither) {
  const UniqueFd fd = driver();
  send("four");
  run_until(loop, [&] { return pty->unread() == 4U; });
  EXPECT_TRUE(while_refused({refused_ioctl(FIONREAD, EIO)}, [&] {
    EXPECT_TRUE(pty->settle(std::nullopt).has_value());
    EXPECT_EQ(pty->left_unread(), std::nullopt);
  }));
}

TEST_F(PtyRefused, WhereItsInputCannotBeSeenThereIsNone) {
  const UniqueFd fd = driver();
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  run_until(loop, [&] { return pty->has_input(); });
  EXPECT_TRUE(while_refused({refused_ioctl(FIONREAD, EIO)}, [&] { EXPECT_FALSE(pty->has_input()); }));
  EXPECT_TRUE(pty->has_input());
}

// A driver's flush takes what had no room as well, or, where that cannot be, leaves the line as it is.
TEST_F(PtyRefused, ABacklogThatCannotBeDroppedStays) {
  const UniqueFd fd = driver();
  send("four");
  run_until(loop, [&] { return pty->unread() == 4U; });
  for (const RefusedCall& refused : {RefusedCall{SYS_openat, EMFILE}, refused_ioctl(TIOCPKT, EIO)}) {
    EXPECT_TRUE(while_refused({refused}, [&] { pty->drop_backlog(true); }));
    EXPECT_EQ(pty->unread(), 4U);
  }
  EXPECT_TRUE(while_refused({refused_ioctl(FIONREAD, EIO)}, [&] { pty->drop_backlog(false); }));
  EXPECT_EQ(pty->unread(), 4U) << "whether there is a backlog is not known";
  pty->drop_backlog(false);
  EXPECT_EQ(pty->unread(), 4U) << "it is no backlog";
  pty->drop_backlog(true);
  EXPECT_EQ(pty->unread(), 0U);
}

class PtyPortRefused : public testing::Test {
 protected:
  PtyPortRefused() { make(); }
  void make() {
    port.emplace(PortContext{&loop, book.log()}, PtyOptions{.link = link});
    port->listen(log);
    const Result<void> prepared = port->prepare();
    EXPECT_TRUE(prepared.has_value()) << prepared.error().message;
    port->open();
  }
  [[nodiscard]] UniqueFd driver() const {
    return UniqueFd(::open(link.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  }
  void until(const std::string& events) {
    run_until(loop, [&] { return log.events == events; });
    EXPECT_EQ(log.events, events);
  }
  // A session of a driver that the line works for.
  void expect_session() {
    log.events.clear();
    log.data.clear();
    UniqueFd fd = driver();
    ASSERT_TRUE(fd);
    ASSERT_EQ(::write(fd.get(), "ask", 3), 3);
    run_until(loop, [&] { return log.data == "ask"; });
    port->write(as_bytes("answer"));
    std::string got;
    run_until(loop, [&] {
      char buffer[16];
      const ssize_t size = ::read(fd.get(), buffer, sizeof buffer);
      if (size > 0) got.append(buffer, static_cast<std::size_t>(size));
      settle(loop);
      return got == "answer";
    });
    fd.reset();
    until("up closed ");
  }
  [[nodiscard]] int master() { return port->supervised()->line_fd(); }
  [[nodiscard]] std::size_t told(const std::string& text) const {
    const std::string all = book.text();
    std::size_t count = 0;
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }

  test::TempDir dir;
  const std::string link = dir / "port";
  Loop loop;
  LogBook book;
  PortLog log;
  std::optional<PtyPort> port;
};

TEST_F(PtyPortRefused, APtyThatCannotBeMadeFreshGivesWayToANewOneWhichIsToldOnce) {
  for (const RefusedCall& refused : {refused_ioctl(TCFLSH, EIO), refused_ioctl(TCFLSH, EBUSY)}) {
    log.events.clear();
    UniqueFd fd = driver();
    until("up ");
    const std::filesystem::path before = std::filesystem::read_symlink(link);
    port->write(as_bytes("left"));
    EXPECT_TRUE(while_refused({refused}, [&] {
      fd.reset();
      until("up closed ");
    }));
    EXPECT_NE(std::filesystem::read_symlink(link), before);
    EXPECT_EQ(std::filesystem::read_symlink(link), port->place().node);
    expect_session();
  }
  EXPECT_EQ(told("a new pty takes its place"), 1U) << book.text();
  EXPECT_THAT(book.text(), HasSubstr("Input/output error; a new pty takes its place"));
}

TEST_F(PtyPortRefused, WhereNoNewOneIsToBeHadEitherThatIsToldAndTheLineGoesOn) {
  UniqueFd fd = driver();
  until("up ");
  port->write(as_bytes("left"));
  const std::filesystem::path before = std::filesystem::read_symlink(link);
  EXPECT_TRUE(while_refused({{SYS_openat, EMFILE}}, [&] {
    fd.reset();
    until("up closed ");
  }));
  EXPECT_THAT(book.text(),
              HasSubstr("Too many open files; what the last driver did not read may reach the next"));
  EXPECT_EQ(std::filesystem::read_symlink(link), before);
  fd = driver();
  until("up closed up ");
  ASSERT_EQ(::write(fd.get(), "ask", 3), 3);
  run_until(loop, [&] { return log.data == "ask"; });
}

TEST_F(PtyPortRefused, AReadThatIsInterruptedOrFindsNothingEndsNoSession) {
  const UniqueFd fd = driver();
  until("up ");
  for (const int error : {EINTR, EAGAIN}) {
    log.data.clear();
    ASSERT_EQ(::write(fd.get(), "ask", 3), 3);
    EXPECT_TRUE(while_refused({refused_on(master(), SYS_read, error)}, [&] {
      for (int n = 0; n < 20; ++n) {
        loop.poll_one();
        port->read_pending();
      }
    }));
    EXPECT_EQ(log.events, "up ");
    EXPECT_EQ(log.data, "");
    run_until(loop, [&] { return log.data == "ask"; });
  }
}

TEST_F(PtyPortRefused, WhatCannotBeWrittenIsToldAndTheSessionGoesOn) {
  for (const int error : {EIO, ENOSPC}) {
    log.events.clear();
    UniqueFd fd = driver();
    until("up ");
    log.dropped = 0;
    EXPECT_TRUE(
        while_refused({refused_on(master(), SYS_write, error)}, [&] { port->write(as_bytes("four")); }));
    EXPECT_EQ(log.dropped, 4U);
    EXPECT_EQ(log.why, "they could not be sent");
    EXPECT_EQ(log.events, "up ");
    fd.reset();
    until("up closed ");
    expect_session();
  }
}

TEST_F(PtyPortRefused, WhatTheKernelHasNoRoomForIsKeptAndSent) {
  for (const int error : {ENOMEM, ENOBUFS, EAGAIN}) {
    log.events.clear();
    log.dropped = 0;
    UniqueFd fd = driver();
    until("up ");
    EXPECT_TRUE(while_refused({refused_on(master(), SYS_write, error)}, [&] {
      port->write(as_bytes("four"));
      EXPECT_EQ(port->unread_by_peer(), 4U);
      for (int n = 0; n < 20; ++n) loop.poll_one();
    }));
    const Reader reader(loop, fd.get());
    run_until(loop, [&] { return reader.got == "four"; });
    EXPECT_EQ(log.dropped, 0U);
    fd.reset();
    run_until(loop, [&] { return log.events.ends_with("closed "); });
  }
}

TEST_F(PtyPortRefused, SettingsThatCannotBeShownAreAnErrorWhileADriverIsThereAndKeptForTheNext) {
  UniqueFd fd = driver();
  until("up ");
  const LineSettings wanted{.baud = 4800};
  EXPECT_TRUE(while_refused({refused_ioctl(TCSETS2, EIO)}, [&] {
    EXPECT_THAT(port->apply(wanted).error().message, HasSubstr("setting the pty: Input/output error"));
  }));
  EXPECT_TRUE(while_refused({refused_ioctl(TCGETS2, EIO)}, [&] {
    EXPECT_THAT(port->apply(wanted).error().message, HasSubstr("Input/output error"));
  }));
  EXPECT_EQ(log.events, "up ");
}

TEST_F(PtyPortRefused, ADriverWhoseSettingsCannotBeReadGoesOn) {
  const UniqueFd fd = driver();
  until("up ");
  EXPECT_TRUE(while_refused({refused_ioctl(TCGETS2, EIO)}, [&] {
    ASSERT_EQ(::write(fd.get(), "ask", 3), 3);
    run_until(loop, [&] { return log.data == "ask"; });
  }));
  EXPECT_EQ(log.events, "up ");
}

TEST_F(PtyPortRefused, WhetherAllIsReadThatCannotBeSeenGivesTheDriverFiveSeconds) {
  PortLog later_log;
  ManualClock clock;
  Loop by_clock{clock};
  const std::string other = dir / "other";
  PtyPort own(PortContext{&by_clock, book.log()}, PtyOptions{.link = other});
  own.listen(later_log);
  ASSERT_TRUE(own.prepare().has_value());
  own.open();
  const UniqueFd fd(::open(other.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  settle(by_clock);
  EXPECT_EQ(later_log.events, "up ");
  EXPECT_TRUE(while_refused({refused_ioctl(FIONREAD, EIO)}, [&] {
    own.hang_up(true);
    (void)let_pass(by_clock, clock, milliseconds(5001));
    EXPECT_EQ(later_log.events, "up ");
    (void)let_pass(by_clock, clock, milliseconds(1));
    EXPECT_EQ(later_log.events, "up hung_up ");
  }));
  EXPECT_EQ(told("it has 5 s to close"), 1U) << book.text();
}

// What one port leaves to the loop is not done to another that has its place in memory by then.
TEST_F(PtyPortRefused, APortThatGoesBeforeItHasItsNewPtyMakesNone) {
  const UniqueFd fd = driver();
  until("up ");
  EXPECT_TRUE(while_refused({refused_ioctl(TCSETS2, EIO)}, [&] { port->hang_up(false); }));
  make();
  const std::string node = port->place().node;
  log.events.clear();
  settle(loop);
  EXPECT_EQ(port->place().node, node);
  EXPECT_EQ(std::filesystem::read_symlink(link), node);
  EXPECT_EQ(log.events, "") << "nor is the new one hung up";
}

// Its pty is made anew within the call that could not have one: nothing is left to be done.
TEST_F(PtyPortRefused, APtyThatCouldNotBeMadeAtOnceIsMadeOnTheNextTurn) {
  const UniqueFd fd = driver();
  until("up ");
  EXPECT_TRUE(while_refused({refused_ioctl(TCSETS2, EIO)}, [&] { port->hang_up(false); }));
  EXPECT_EQ(port->place().node, "") << "there is no line";
  EXPECT_EQ(port->name(), "pty:" + link);
  port->write(as_bytes("four"));
  EXPECT_EQ(log.dropped, 4U);
  EXPECT_EQ(log.why, "no driver had it open");
  EXPECT_EQ(port->unread_by_peer(), 0U);
  EXPECT_FALSE(port->congested());
  EXPECT_EQ(master(), -1);
  EXPECT_TRUE(port->apply(LineSettings{.baud = 4800}).has_value());
  until("up hung_up ");
  EXPECT_THAT(book.text(), Not(HasSubstr("is dead until")));
  EXPECT_EQ(std::filesystem::read_symlink(link), port->place().node);
  expect_session();
}

}  // namespace
}  // namespace porttape
