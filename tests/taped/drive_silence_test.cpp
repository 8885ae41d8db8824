// How long the replaying port, in the driver's place, waits for a device that says nothing: by a moved clock.

#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
#include "libport/taped/replayed_driver.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// "ask" is answered by "42"; ten seconds later the recorded driver writes "more", which nothing answers.
class DriveSilence : public testing::Test {
 protected:
  DriveSilence() {
    test::write_file(dir / "t.logw", test::block_bytes({{1'000, "ask"}, {10'001'000, "more"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{2'000, "42"}}));
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                              encode(tape_time_us(60'000'000), event::Close{})));
    ReplayOptions options;
    options.tape = literal_tape(dir / "t.log");
    options.config.writer = Writer::device;
    options.silence = seconds(1);
    port = std::make_unique<ReplayedDriver>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    EXPECT_TRUE(port->prepare().has_value());
    port->open();
    port->set_reading(false);
  }
  void device_comes_up() { port->set_reading(true); }
  void device_sends(std::string_view text) { port->write(as_bytes(text)); }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }
  void expect_end(const std::string& outcome) {
    run_until(loop, [this] { return port->report().has_value(); });
    EXPECT_EQ(port->report()->outcome, outcome);
  }

  test::TempDir dir;
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  PortLog log;
  std::unique_ptr<ReplayPort> port;
};

TEST_F(DriveSilence, IsCountedFromTheQuestion) {
  device_comes_up();
  pass(milliseconds(999));
  EXPECT_EQ(log.data, "ask");
  EXPECT_EQ(log.events, "up ");
  pass(milliseconds(3));
  expect_end("the device was silent for 1 s");
}

TEST_F(DriveSilence, IsCountedAnewFromEachByte) {
  device_comes_up();
  pass(milliseconds(900));
  device_sends("4");
  pass(milliseconds(900));
  EXPECT_EQ(log.events, "up ");
  pass(milliseconds(200));
  expect_end("the device was silent for 1 s");
}

TEST_F(DriveSilence, IsNotThePauseOfTheRecordedDriver) {
  device_comes_up();
  pass(milliseconds(10));
  device_sends("42");
  pass(milliseconds(9'900));
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.data, "ask");
  pass(milliseconds(200));
  EXPECT_EQ(log.data, "askmore");
}

TEST_F(DriveSilence, OfALineThatDoesNotComeUpIsAsLong) {
  pass(milliseconds(999));
  EXPECT_EQ(log.events, "up ");
  pass(milliseconds(1));
  EXPECT_EQ(log.events, "up closed finished6 ");
}

TEST_F(DriveSilence, BeginsWhenTheLineIsUp) {
  pass(milliseconds(900));
  device_comes_up();
  pass(milliseconds(900));
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.data, "ask");
}

TEST_F(DriveSilence, OfALineThatTakesNothingIsNamedSo) {
  device_comes_up();
  port->set_reading(false);
  pass(milliseconds(1'100));
  expect_end("the device's line took nothing for 1 s");
}

}  // namespace
}  // namespace porttape
