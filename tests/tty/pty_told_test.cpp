// What a PtyPort says of bytes that nobody gets, and by which name it is opened.

#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "tests/tty/pty_rig.hpp"

namespace porttape {
namespace {

class PtyToldTest : public PtyPortTest {};

TEST_F(PtyToldTest, BytesForNobodyAreToldWithTheReason) {
  start();
  port.write(as_bytes("abc"));
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(log.why, "no driver had it open");
  EXPECT_EQ(port.unread_by_peer(), 0U);
}

TEST_F(PtyToldTest, WhatADriverDidNotTakeIsToldAtTheClose) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  const std::string block(4096, 'b');
  while (!port.congested()) port.write(as_bytes(block));
  EXPECT_EQ(log.dropped, 0U);
  port.close();
  EXPECT_GT(log.dropped, 0U);
  EXPECT_EQ(log.why, "the driver did not take them");
  EXPECT_FALSE(port.congested());
}

TEST_F(PtyToldTest, WhatAHangUpTookAwayIsToldWithTheReason) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  port.set_reading(false);
  ASSERT_EQ(::write(fd.get(), "abc", 3), 3);
  port.hang_up(false);
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(log.why, "the line was hung up before they could be passed on");
  until("up hung_up ");
}

TEST_F(PtyToldTest, AHangUpOfNobodyIsNoNews) {
  start();
  const std::string node = port.place().node;
  port.hang_up(false);
  port.hang_up(true);
  while (loop.poll_one()) {
  }
  EXPECT_EQ(log.events, "");
  EXPECT_EQ(port.place().node, node);
}

TEST_F(PtyToldTest, ItIsNamedByItsLinkAndWithoutOneByThePtyItself) {
  PtyPort plain(PortContext{&loop, book.log()}, {});
  EXPECT_EQ(plain.name(), "pty");
  EXPECT_EQ(plain.place().node, "");
  ASSERT_TRUE(plain.prepare().has_value());
  EXPECT_TRUE(plain.place().node.starts_with("/dev/pts/"));
  EXPECT_EQ(plain.place().path, plain.place().node);
  EXPECT_EQ(plain.name(), "pty:" + plain.place().node);
  start();
  EXPECT_EQ(port.place().path, link);
  EXPECT_EQ(port.name(), "pty:" + link);
  EXPECT_NE(book.text().find(link + " is there (" + port.place().node + ")"), std::string::npos);
}

TEST_F(PtyToldTest, APtyThatIsAnnouncedIsPrintedUnlessItHasALink) {
  PtyPort plain(PortContext{.loop = &loop, .log = book.log(), .announces = true}, {});
  testing::internal::CaptureStdout();
  ASSERT_TRUE(plain.prepare().has_value());
  EXPECT_EQ(testing::internal::GetCapturedStdout(), plain.place().node + "\n");
  PtyPort linked(PortContext{.loop = &loop, .log = book.log(), .announces = true}, {.link = link});
  testing::internal::CaptureStdout();
  ASSERT_TRUE(linked.prepare().has_value());
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
}

TEST_F(PtyToldTest, WithoutASupervisorThereAreNoSignals) {
  EXPECT_FALSE(port.shows_signals());
  EXPECT_FALSE(port.end_writing());
}

}  // namespace
}  // namespace porttape
