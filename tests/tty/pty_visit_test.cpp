// Opens and closes that no event reports one by one, and that looks at the line have to find.

#include <chrono>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/loop/timer.hpp"
#include "tests/support/port_log.hpp"
#include "tests/tty/pty_rig.hpp"

namespace porttape {
namespace {

TEST_F(PtyPortTest, InABriefProgramOpensAreLookedForFirstAndToldLater) {
  loop.file_events().begin_after(std::chrono::milliseconds(5));
  start();
  UniqueFd fd = driver();
  until("up ");
  fd.reset();
  until("up closed ");
  bool late = false;
  Timer after(loop, [&late] { late = true; });
  after.set_after(std::chrono::milliseconds(10));
  run_until(loop, [&late] { return late; });
  EXPECT_EQ(book.text().find("inotify"), std::string::npos) << book.text();
  fd = driver();
  until("up closed up ");
  fd.reset();
  fd = driver();  // told one by one now: a reopen
  until("up closed up closed up ");
}

TEST_F(PtyPortTest, InABriefProgramADriverThatClosesAtOnceIsSeenOnceWhole) {
  loop.file_events().begin_after(std::chrono::hours(1));
  start();
  std::string expected;
  for (int i = 0; i < 200; ++i) {
    driver().reset();
    expected += "up closed ";
    until(expected);
  }
  UniqueFd fd = driver();  // what would be told late comes before this
  until(expected + "up ");
}

TEST_F(PtyPortTest, InABriefProgramOneThatClosesAtOnceIsSeenBehindOneThatStayed) {
  loop.file_events().begin_after(std::chrono::hours(1));
  start();
  UniqueFd fd = driver();
  until("up ");
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  fd.reset();
  until("up closed ");
  driver().reset();
  until("up closed up closed ");
}

TEST_F(PtyPortTest, OneThatClosesAtOnceIsSeenWhereInotifyIsRefused) {
  loop.file_events().refuse();
  start();
  driver().reset();
  until("up closed ");
  driver().reset();
  until("up closed up closed ");
}

TEST_F(PtyPortTest, OneThatClosesAsInotifyBeginsIsSeenOnce) {
  loop.file_events().begin_after(std::chrono::milliseconds(1));
  start();
  Loop other;  // this one's time to begin has come, and it has not looked
  bool late = false;
  Timer after(other, [&late] { late = true; });
  after.set_after(std::chrono::milliseconds(2));
  run_until(other, [&late] { return late; });
  driver().reset();
  until("up closed ");
  driver().reset();
  until("up closed up closed ");
}

TEST_F(PtyPortTest, SettingsThatTheDeviceShowsAreNoVisit) {
  loop.file_events().begin_after(std::chrono::hours(1));
  start();
  for (const bool flow : {true, false, true}) {
    LineSettings settings;
    settings.sw_flow = flow;
    ASSERT_TRUE(port.apply(settings).has_value());
  }
  const UniqueFd fd = driver();
  until("up ");
}

}  // namespace
}  // namespace porttape
