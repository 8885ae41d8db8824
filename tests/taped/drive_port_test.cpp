// The replaying port in the driver's place: what it does with its line, and the ends of a device that goes
// away or says nothing.

#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
#include "libport/taped/replayed_driver.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

class DrivePortTest : public testing::Test {
 protected:
  // "ask", answered by "42", and what `events` are between open and close.
  void make_tape(const std::string& events = {}, std::int64_t close_us = 5'000) {
    test::write_file(dir / "t.logw", test::block_bytes({{1'000, "ask"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{2'000, "42"}}));
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                              events + encode(tape_time_us(close_us), event::Close{})));
  }
  // The device's line is not up yet.
  void start(std::optional<Nanos> silence = std::nullopt, bool waits = false) {
    ReplayOptions options;
    options.tape = literal_tape(dir / "t.log");
    options.config.writer = Writer::device;
    options.config.on_mismatch = OnMismatch::fail;
    options.silence = silence;
    options.waits_for_line = waits;
    port = std::make_unique<ReplayedDriver>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
    port->set_reading(false);
  }
  void device_comes_up() { port->set_reading(true); }
  void device_sends(std::string_view text) { port->write(as_bytes(text)); }
  void wait_for_question() {
    run_until(loop, [this] { return log.data == "ask"; });
  }
  void wait_for_report() {
    run_until(loop, [this] { return port->report().has_value(); });
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  PortLog log;
  std::unique_ptr<ReplayPort> port;
};

TEST_F(DrivePortTest, AsksOnceTheDevicesLineIsUpAndClosesAsRecorded) {
  make_tape();
  start();
  EXPECT_EQ(log.events, "up ");
  Timer later(loop, [this] {
    EXPECT_EQ(log.data, "") << "nothing is sent to a line that is not there";
    device_comes_up();
  });
  later.set_after(milliseconds(20));
  wait_for_question();
  device_sends("42");
  wait_for_report();
  EXPECT_EQ(log.events, "up closed finished0 ");
  EXPECT_EQ(port->report()->verdict, Verdict::pass);
  EXPECT_EQ(port->report()->writer, Writer::device);
}

TEST_F(DrivePortTest, TheLineIsSetAsTheRecordedDriverFoundItAndThenAsItSetIt) {
  const auto set = [](Side by, unsigned baud) {
    return encode(tape_time_us(100), event::Settings{by, SeenSettings{.baud = baud}, SettingsOrder::exact});
  };
  make_tape(set(Side::device, 19'200) + set(Side::driver, 115'200) +
            encode(tape_time_us(200), event::Flush{FlushQueue::in}));
  start();
  EXPECT_EQ(log.events, "settings up ");
  EXPECT_EQ(log.settings.baud, 19'200U);
  device_comes_up();
  wait_for_question();
  EXPECT_EQ(log.events, "settings up settings flush_in ");
  EXPECT_EQ(log.settings.baud, 115'200U);
}

TEST_F(DrivePortTest, TheRecordedDriversFlushesAreOfTheirQueues) {
  using Queue = FlushQueue;
  const auto flush = [](std::int64_t us, std::optional<Queue> queue) {
    return encode(tape_time_us(us), event::Flush{queue});
  };
  make_tape(flush(100, Queue::in) + flush(200, Queue::out) + flush(300, Queue::both) +
            flush(400, std::nullopt));
  start();
  device_comes_up();
  wait_for_question();
  EXPECT_EQ(log.events, "up flush_in flush_out flush_both flush_both ");
}

TEST_F(DrivePortTest, TheRecordedDriversSignalsAreMade) {
  make_tape(encode(tape_time_us(100), signal_event({Side::driver, {LineSignal::Name::rts, false}})) +
            encode(tape_time_us(150), signal_event({Side::device, {LineSignal::Name::cts, false}})) +
            encode(tape_time_us(200), signal_event({Side::driver, {LineSignal::Name::brk, true}})));
  start();
  device_comes_up();
  wait_for_question();
  EXPECT_EQ(log.events, "up rts- break+ ");
}

TEST_F(DrivePortTest, AnotherAnswerEndsTheLineAtOnceAndItsHintIsLookedForAmongTheAnswers) {
  make_tape();
  start();
  device_comes_up();
  wait_for_question();
  device_sends("2");
  EXPECT_EQ(log.events, "up hung_up finished0 ");
  wait_for_report();
  EXPECT_EQ(port->report()->verdict, Verdict::data_mismatch);
  EXPECT_THAT(port->report()->mismatch->hint, HasSubstr("comes later at offset 1"));
}

TEST_F(DrivePortTest, ASilentDeviceEndsTheRun) {
  make_tape();
  start(milliseconds(30));
  device_comes_up();
  wait_for_question();
  device_sends("4");
  wait_for_report();
  EXPECT_EQ(port->report()->verdict, Verdict::incomplete);
  EXPECT_EQ(port->report()->outcome, "the device was silent for 0.03 s");
  EXPECT_EQ(as_text(port->report()->next_expected), "2");
}

TEST_F(DrivePortTest, ALineThatTakesNothingEndsTheRun) {
  make_tape();
  start(milliseconds(30));
  device_comes_up();
  port->set_reading(false);
  wait_for_report();
  EXPECT_EQ(port->report()->outcome, "the device's line took nothing for 0.03 s");
}

TEST_F(DrivePortTest, ALineThatNeverComesUpIsAMissingDevice) {
  make_tape();
  start(milliseconds(30));
  run_until(loop, [this] { return log.events == "up closed finished6 "; });
  EXPECT_FALSE(port->report());
  EXPECT_THAT(book.text(), HasSubstr("did not come up within 0.03 s"));
}

TEST_F(DrivePortTest, OneThatIsToBeWaitedForIs) {
  make_tape();
  start(milliseconds(1), true);
  Timer later(loop, [this] { device_comes_up(); });
  later.set_after(milliseconds(30));
  wait_for_question();
}

TEST_F(DrivePortTest, ADeviceThatHangsUpEndsTheRunAndIsNamed) {
  make_tape();
  start();
  device_comes_up();
  wait_for_question();
  port->hang_up(true);
  EXPECT_EQ(log.events, "up hung_up finished0 ");
  wait_for_report();
  EXPECT_EQ(port->report()->verdict, Verdict::incomplete);
  EXPECT_EQ(port->report()->outcome, "the device ended the line, and the tape goes on");
}

TEST_F(DrivePortTest, AnEndOfSendingIsTakenForOneOfTheLineWhereTheTapeHasNone) {
  make_tape();
  start();
  device_comes_up();
  wait_for_question();
  EXPECT_FALSE(port->end_writing());
  device_sends("42");
  EXPECT_TRUE(port->end_writing()) << "the tape is about to close";
  wait_for_report();
  EXPECT_EQ(port->report()->verdict, Verdict::pass);
}

TEST_F(DrivePortTest, AnEndBeforeTheTapesIsIncompleteThoughAllAnswersCame) {
  make_tape({}, 60'000'000);
  start();
  device_comes_up();
  wait_for_question();
  device_sends("42");
  port->finish();
  run_until(loop, [this] { return log.status.has_value(); });
  EXPECT_EQ(log.status, 5);
}

}  // namespace
}  // namespace porttape
