// The line that a replaying port shows: its settings, its signals and its drains.

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/taped/replay_port_fixture.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

// A tape whose device has 1200 baud; its driver asks for 300, which it takes, 7, which it refuses, and 150,
// for which it takes 134.
class SettingsOfATape : public ReplayPortTest {
 protected:
  SettingsOfATape() {
    const auto by = [](Side side, unsigned baud) {
      return event::Settings{side, {.baud = baud, .stop_bits = 1}, SettingsOrder::exact};
    };
    write_events(
        encode(tape_time_us(0), event::Open{}) +
        encode(tape_time_us(1), event::Settings{Side::device, SeenSettings::of({.baud = 1200}), {}}) +
        encode(tape_time_us(100'000), by(Side::driver, 300)) +
        encode(tape_time_us(200'000), by(Side::driver, 7)) +
        encode(tape_time_us(200'001), by(Side::device, 300)) +
        encode(tape_time_us(300'000), by(Side::driver, 150)) +
        encode(tape_time_us(300'001), by(Side::device, 134)) + encode(tape_time_us(400'000), event::Close{}) +
        encode(tape_time_us(500'000), event::Open{}) + encode(tape_time_us(600'000), by(Side::driver, 300)) +
        encode(tape_time_us(700'000), event::Close{}));
  }
  void write_events(const std::string& events, const std::string& device = "serial:/dev/ttyUSB0") {
    test::write_file(dir / "t.logr", test::block_bytes({{0, "a"}, {650'000, "b"}}));
    test::write_file(dir / "t.loge",
                     as_bytes(encode(TapeHeader{.device = device, .driver = "pty:"}) + events));
  }
  // As a session does it.
  Result<void> set(unsigned baud) {
    const SeenSettings seen{.baud = baud};
    port->tell(line::Settings{seen, SettingsOrder::sampled});
    return port->apply(seen.over(*port->settings()));
  }
  unsigned baud() { return port->settings().value().baud; }
};

TEST_F(SettingsOfATape, AreThoseOfItsDevice) {
  start();
  EXPECT_EQ(port->settings(), LineSettings{.baud = 1200});
  EXPECT_TRUE(set(300).has_value());
  EXPECT_EQ(baud(), 300U);
  EXPECT_EQ(log.events, "up ");
  const Result<void> refused = set(7);
  ASSERT_FALSE(refused.has_value());
  EXPECT_THAT(refused.error().message, HasSubstr("on the tape the device did not take 7 baud, 8N1"));
  EXPECT_EQ(baud(), 300U);
  EXPECT_TRUE(set(150).has_value());
  EXPECT_EQ(baud(), 134U);
  EXPECT_EQ(log.events, "up settings ");
  EXPECT_EQ(log.settings.baud, 134U);
  port->close();
  EXPECT_EQ(baud(), 1200U) << "its own again";
}

TEST_F(SettingsOfATape, AreThoseThatHoldWhereASessionBegins) {
  session = 2;
  start();
  EXPECT_EQ(baud(), 1200U);
}

TEST_F(SettingsOfATape, AnOlderRecordersAreTheOptionsItOpenedTheDeviceWith) {
  write_events({}, "serial:/dev/ttyUSB0,alwaysopen,baud=57600,parity=even");
  start();
  EXPECT_EQ(port->settings(), (LineSettings{.baud = 57600, .parity = Parity::even}));
}

TEST_F(SettingsOfATape, WhereNothingTellsOfThemThereAreNone) {
  for (const char* device : {"tcp:localhost:1,baud=3", "serial:/dev/ttyUSB0,baud=much", ""}) {
    write_events({}, device);
    start();
    EXPECT_EQ(port->settings(), std::nullopt) << device;
    EXPECT_FALSE(port->apply({}).has_value());
  }
}

TEST_F(SettingsOfATape, TheDriversAreHeldAgainstIt) {
  once = true;
  start(dir / "report.json");
  (void)set(300);
  (void)set(150);
  port->close();
  port->open();
  (void)set(300);
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  const std::string file(as_text(test::read_file(dir / "report.json")));
  EXPECT_THAT(file, HasSubstr(R"("settings":{"recorded":4,"made":3,)"
                              R"("missing":[{"tape_us":200000,"baud":7,"stopbits":1}],"checked":false})"));
  EXPECT_THAT(book.text(), HasSubstr("the driver never made its line 7 baud, 1 stop bit"));
}

// An answer between two changes of the device's, and a drain of the driver's.
class SignalsOfATape : public ReplayPortTest {
 protected:
  SignalsOfATape() {
    const auto by_device = [](std::int64_t us, LineSignal::Name name, bool on) {
      return encode(tape_time_us(us), signal_event({Side::device, {name, on}}));
    };
    const std::string events =
        encode(TapeHeader{.device = "serial:/dev/x", .driver = "pty"}) +
        encode(tape_time_us(0), event::Open{}) + by_device(10, LineSignal::Name::cts, true) +
        encode(tape_time_us(1'100), event::Drain{Micros{5'000}}) +
        by_device(3'000, LineSignal::Name::cts, false) + encode(tape_time_us(9'000), event::Close{});
    test::write_file(dir / "t.loge", as_bytes(events));
    test::write_file(dir / "t.logw", test::block_bytes({{1'000, "ask"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{2'000, "one"}, {4'000, "two"}}));
  }
};

TEST_F(SignalsOfATape, AreToldInTheirPlaceWhereTheyAreWanted) {
  start({}, OnMismatch::fail, false);
  port->tell(line::WatchSignals{true});
  port->open();
  EXPECT_EQ(log.events, "up cts+ ");
  write("ask");
  run_until(loop, [this] { return log.data == "onetwo"; });
  EXPECT_EQ(log.events, "up cts+ cts- ");
  EXPECT_EQ(log.signals_after, (std::vector<std::size_t>{0, 3}));
}

TEST_F(SignalsOfATape, AreNotToldWhereNobodyLooks) {
  start();
  write("ask");
  run_until(loop, [this] { return log.data == "onetwo"; });
  EXPECT_EQ(log.events, "up ");
}

TEST_F(SignalsOfATape, ADrainLastsAsLongAsItsRecordedOne) {
  start();
  const Instant begin = loop.now();
  int sent = 0;
  log.drain(*port, [&sent] { ++sent; });
  EXPECT_EQ(sent, 0);
  run_until(loop, [&sent] { return sent > 0; });
  EXPECT_GE(loop.now() - begin, std::chrono::milliseconds(5));
  log.drain(*port, [&sent] { ++sent; });
  EXPECT_EQ(sent, 2) << "the tape has no other";
}

TEST_F(SignalsOfATape, EachRunHasTheRecordedDrainsFromTheFirstOn) {
  start();
  int sent = 0;
  for (const int run : {0, 1}) {
    log.drain(*port, [&sent] { ++sent; });
    EXPECT_EQ(sent, run) << "it lasts";
    port->close();
    port->open();
  }
  EXPECT_EQ(sent, 2);
}

TEST_F(SignalsOfATape, WithoutTimingADrainIsOverAtOnce) {
  timing = Timing::none;
  start();
  bool sent = false;
  log.drain(*port, [&sent] { sent = true; });
  EXPECT_TRUE(sent);
}

TEST_F(SignalsOfATape, ADrainEndsWithTheLine) {
  start();
  int sent = 0;
  log.drain(*port, [&sent] { ++sent; });
  port->close();
  EXPECT_EQ(sent, 1);
}

}  // namespace
}  // namespace porttape
