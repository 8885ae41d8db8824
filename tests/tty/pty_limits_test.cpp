// By a clock that is moved: how long a pty waits for its driver, and for one that cannot be made.

#include <chrono>
#include <fcntl.h>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tty/pty_port.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class PtyLimits : public testing::Test {
 protected:
  PtyLimits() {
    port.listen(log);
    const Result<void> prepared = port.prepare();
    EXPECT_TRUE(prepared.has_value()) << prepared.error().message;
    port.open();
    driver = open_it();
    settle(loop);
    EXPECT_EQ(log.events, "up ");
  }
  [[nodiscard]] UniqueFd open_it() const {
    return UniqueFd(::open(link.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  }
  void write(const std::string& text) const {
    ASSERT_EQ(::write(driver.get(), text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  void leave() {
    driver.reset();
    settle(loop);
  }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }
  bool told(const std::string& text) const { return book.text().find(text) != std::string::npos; }

  test::TempDir dir;
  const std::string link = (dir.path() / "port").string();
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  PortLog log;
  PtyPort port{PortContext{&loop, book.log()}, PtyOptions{.link = link}};
  UniqueFd driver;
};

TEST_F(PtyLimits, WhatADriverLeftIsKeptForTenSecondsWhereItIsWanted) {
  log.wanted = true;
  port.set_reading(false);
  write("rest");
  leave();
  pass(seconds(10) - Nanos(1));
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.dropped, 0U);
  pass(Nanos(1));
  EXPECT_EQ(log.events, "up closed ");
  EXPECT_EQ(log.dropped, 4U);
  EXPECT_EQ(log.why, "the driver had closed before the device could take them");
}

TEST_F(PtyLimits, WhatADriverLeftIsKeptAsLongAsTheDeviceTakesBytes) {
  log.wanted = true;
  log.peer_unread = 1000;
  port.set_reading(false);
  EXPECT_FALSE(port.left_bytes());
  write("rest");
  EXPECT_FALSE(port.left_bytes()) << "it is still there";
  leave();
  EXPECT_TRUE(port.left_bytes());
  for (int n = 0; n < 20; ++n) {
    --*log.peer_unread;
    pass(seconds(9));
    ASSERT_EQ(log.events, "up ") << n;
  }
  pass(seconds(10));
  EXPECT_EQ(log.events, "up closed ");
  EXPECT_EQ(log.dropped, 4U);
  EXPECT_FALSE(port.left_bytes());
}

TEST_F(PtyLimits, WhatIsWantedNoMoreIsDroppedAQuarterOfASecondLater) {
  log.wanted = true;
  port.set_reading(false);
  write("rest");
  leave();
  pass(seconds(1));
  log.wanted = false;
  pass(milliseconds(250));
  EXPECT_EQ(log.events, "up closed ");
}

TEST_F(PtyLimits, WhatIsKeptIsReadOnceReadingIsOn) {
  log.wanted = true;
  port.set_reading(false);
  write("rest");
  leave();
  pass(seconds(9));
  port.set_reading(true);
  settle(loop);
  EXPECT_EQ(log.data, "rest");
  EXPECT_EQ(log.events, "up closed ");
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(PtyLimits, OneByteThatNobodyWantsIsTold) {
  port.set_reading(false);
  write("x");
  leave();
  EXPECT_EQ(log.events, "up closed ");
  EXPECT_EQ(log.dropped, 1U);
}

TEST_F(PtyLimits, ADriverThatLeftNothingLosesNothing) {
  port.set_reading(false);
  leave();
  EXPECT_EQ(log.events, "up closed ");
  EXPECT_EQ(log.why, "");
}

TEST_F(PtyLimits, AHangUpThatWaitsIsMadeTwoMillisecondsAfterTheLastByteIsRead) {
  port.write(as_bytes("tail"));
  port.hang_up(true);
  pass(milliseconds(100));
  EXPECT_EQ(log.events, "up ");
  char buffer[16];
  ASSERT_EQ(::read(driver.get(), buffer, sizeof buffer), 4);
  pass(milliseconds(2) - Nanos(1));
  EXPECT_EQ(log.events, "up ");
  pass(Nanos(1));
  EXPECT_EQ(log.events, "up hung_up ");
}

TEST_F(PtyLimits, OneUnreadByteKeepsTheLine) {
  port.write(as_bytes("x"));
  port.hang_up(true);
  pass(seconds(60));
  EXPECT_EQ(log.events, "up ");
}

TEST_F(PtyLimits, AnIdleLineIsHungUpAtTheFirstLook) {
  port.hang_up(true);
  EXPECT_EQ(log.events, "up ");
  pass(milliseconds(2));
  EXPECT_EQ(log.events, "up hung_up ");
}

TEST_F(PtyLimits, ADriverThatClosesMeanwhileIsNotHungUp) {
  port.write(as_bytes("tail"));
  port.hang_up(true);
  pass(milliseconds(100));
  leave();
  pass(seconds(1));
  EXPECT_EQ(log.events, "up closed ");
}

TEST_F(PtyLimits, WhereItCannotBeSeenADriverHasFiveSecondsToRead) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  port.write(as_bytes("tail"));
  {
    const test::NoDescriptors none(unsanitized);
    port.hang_up(true);
    pass(milliseconds(2));  // the first look, which finds no answer
    EXPECT_TRUE(told("it has 5 s to close")) << book.text();
    pass(seconds(5) - Nanos(1));
    EXPECT_EQ(log.events, "up ");
    pass(Nanos(1));
    EXPECT_EQ(log.events, "up hung_up ");
  }
  EXPECT_EQ(book.text().find("to close"), book.text().rfind("to close")) << "once";
}

TEST_F(PtyLimits, APtyThatCannotBeMadeIsTriedAgainEverLaterUpToFiveSeconds) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  {
    const test::NoDescriptors none(unsanitized);
    port.hang_up(false);
    settle(loop);
    EXPECT_EQ(log.events, "up hung_up ");
    for (const int wait : {500, 1000, 2000, 4000, 5000, 5000}) {
      ASSERT_TRUE(loop.next_timer());
      EXPECT_EQ(*loop.next_timer() - clock.now(), milliseconds(wait));
      pass(milliseconds(wait));
    }
  }
  EXPECT_EQ(book.text().find("is dead until"), book.text().rfind("is dead until")) << "once";
  EXPECT_TRUE(told("Too many open files; pty:" + link + " is dead until that is mended")) << book.text();
  pass(seconds(5));
  EXPECT_TRUE(told("there is a pty for it again")) << book.text();
  driver = open_it();
  settle(loop);
  EXPECT_EQ(log.events, "up hung_up up ");
}

}  // namespace
}  // namespace porttape
