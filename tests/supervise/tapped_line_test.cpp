// The two ports of a driver that keeps its own device, and what each tells of what is seen.

#include "libport/supervise/tapped_line.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/port_log.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using Name = LineSignal::Name;

class TappedLineTest : public testing::Test {
 protected:
  void SetUp() override {
    driver->listen(of_driver);
    device->listen(of_device);
  }
  void open_all() {
    driver->open();
    device->open();
    line.opened("/dev/ttyUSB0", settings);
    of_driver.events.clear();
    of_device.events.clear();
  }

  const LineSettings settings{.baud = 19200};
  PortLog of_driver;
  PortLog of_device;
  TappedLine line{"/dev/given"};
  std::unique_ptr<Port> driver = line.driver_port();
  std::unique_ptr<Port> device = line.device_port();
};

TEST_F(TappedLineTest, TheDriverIsUpWhileItHasItsDeviceOpen) {
  driver->open();
  EXPECT_EQ(of_driver.events, "");
  EXPECT_FALSE(line.open());
  line.opened("/dev/ttyUSB0", settings);
  EXPECT_EQ(of_driver.events, "up ");
  EXPECT_TRUE(line.open());
  line.closed();
  EXPECT_EQ(of_driver.events, "up closed ");
  EXPECT_FALSE(line.open());
  line.closed();
  EXPECT_EQ(of_driver.events, "up closed ") << "once";
  line.opened("/dev/ttyUSB0", settings);
  line.opened("/dev/ttyUSB0", settings);
  EXPECT_EQ(of_driver.events, "up closed up ") << "once";
}

TEST_F(TappedLineTest, APortThatOpensLaterFindsADriverThatIsThere) {
  line.opened("/dev/ttyUSB0", settings);
  EXPECT_EQ(of_driver.events, "");
  driver->open();
  EXPECT_EQ(of_driver.events, "up ");
  driver->close();
  line.closed();
  EXPECT_EQ(of_driver.events, "up ") << "who has closed hears no more";
  line.opened("/dev/ttyUSB0", settings);
  EXPECT_EQ(of_driver.events, "up ");
}

TEST_F(TappedLineTest, ThePortsSayWhoTheyAre) {
  EXPECT_EQ(driver->name(), "the command");
  EXPECT_EQ(driver->place().path, "/dev/given");
  EXPECT_TRUE(driver->passive());
  EXPECT_TRUE(driver->shows_signals());
  EXPECT_FALSE(driver->keeps_datagrams());
  EXPECT_FALSE(driver->congested());
  EXPECT_FALSE(driver->end_writing());
  EXPECT_EQ(driver->unread_by_peer(), 0U);
  EXPECT_EQ(device->name(), "the command's device");
  EXPECT_EQ(line.device_name(), "");
  EXPECT_FALSE(device->identity().has_value());
  EXPECT_FALSE(device->passive());
  EXPECT_TRUE(device->shows_signals());
  EXPECT_FALSE(device->keeps_datagrams());
  EXPECT_FALSE(device->congested());
  EXPECT_FALSE(device->end_writing());
  EXPECT_EQ(device->unread_by_peer(), std::nullopt);
  line.opened("/dev/ttyUSB77", settings);
  EXPECT_EQ(device->name(), "serial:/dev/ttyUSB77");
  EXPECT_EQ(line.device_name(), "serial:/dev/ttyUSB77");
  EXPECT_FALSE(device->identity().has_value()) << "there is no such device";
  EXPECT_EQ(device->settings(), settings);
}

TEST_F(TappedLineTest, WhatIsSeenComesOutOfThePortWhosePeerDidIt) {
  open_all();
  line.wrote(test::bytes_of("ask"));
  line.got(test::bytes_of("answer"));
  EXPECT_EQ(of_driver.data, "ask");
  EXPECT_EQ(of_device.data, "answer");
  const LineSettings made{.baud = 57600};
  line.made(made);
  EXPECT_EQ(of_driver.settings, SeenSettings::of(made));
  EXPECT_EQ(of_driver.settings_order, SettingsOrder::exact);
  EXPECT_EQ(device->settings(), made);
  line.driver_did(line::Flush{FlushQueue::in});
  line.driver_did(LineSignal{Name::rts, false});
  line.device_did(LineSignal{Name::cts, true});
  EXPECT_EQ(of_driver.events, "settings flush_in rts- ");
  EXPECT_EQ(of_device.events, "cts+ ");
}

TEST_F(TappedLineTest, OfADriverThatIsNotUpNothingIsTold) {
  driver->open();
  line.wrote(test::bytes_of("ask"));
  line.made(settings);
  line.driver_did(line::Flush{FlushQueue::both});
  line.driver_did(LineSignal{Name::rts, true});
  line.drains()();
  EXPECT_EQ(of_driver.events, "");
  EXPECT_EQ(of_driver.data, "");
}

// The session opens its device once its driver is there, and the driver may have read by then.
TEST_F(TappedLineTest, WhatTheDeviceSaidBeforeItIsOpenedComesInItsOrder) {
  line.got(test::bytes_of("lost"));  // nobody has it open
  line.opened("/dev/ttyUSB0", settings);
  line.got(test::bytes_of("a"));
  line.device_did(LineSignal{Name::cd, true});
  line.got(test::bytes_of("b"));
  EXPECT_EQ(of_device.data, "");
  device->open();
  EXPECT_EQ(of_device.data, "ab");
  EXPECT_EQ(of_device.events, "up cd+ ");
  EXPECT_EQ(of_device.signals_after, std::vector<std::size_t>{1});
  device->open();
  EXPECT_EQ(of_device.data, "ab") << "once";
}

TEST_F(TappedLineTest, WhatWasSaidBeforeACloseIsForgotten) {
  line.opened("/dev/ttyUSB0", settings);
  line.got(test::bytes_of("a"));
  device->close();
  device->open();
  EXPECT_EQ(of_device.data, "");
}

TEST_F(TappedLineTest, ALineThatIsLostIsToldOnce) {
  open_all();
  EXPECT_FALSE(line.lost());
  line.lost("the line hung up");
  EXPECT_TRUE(line.lost());
  EXPECT_EQ(of_device.events, "lost ");
  EXPECT_EQ(of_device.error.message, "serial:/dev/ttyUSB0: the line hung up");
  EXPECT_EQ(of_device.error.code, Errc::device_lost);
  line.lost("again");
  EXPECT_EQ(of_device.events, "lost ");
  line.got(test::bytes_of("late"));
  EXPECT_EQ(of_device.data, "");
  EXPECT_EQ(of_driver.events, "") << "the driver still has it open";
  line.closed();
  line.opened("/dev/ttyUSB0", settings);
  EXPECT_FALSE(line.lost()) << "it is another one";
}

TEST_F(TappedLineTest, ALineThatNobodyHasOpenIsNotLost) {
  driver->open();
  device->open();
  line.lost("gone");
  EXPECT_FALSE(line.lost());
  EXPECT_EQ(of_device.events, "up ");
}

TEST_F(TappedLineTest, ALossBeforeTheDeviceIsOpenedIsToldBehindWhatCame) {
  line.opened("/dev/ttyUSB0", settings);
  line.got(test::bytes_of("a"));
  line.lost("gone");
  line.got(test::bytes_of("b"));
  EXPECT_EQ(of_device.events, "");
  device->open();
  EXPECT_EQ(of_device.data, "a");
  EXPECT_EQ(of_device.events, "up lost ");
}

TEST_F(TappedLineTest, ADrainLastsAsLongAsTheDrivers) {
  open_all();
  std::string ended;
  of_device.drain(*device, [&] { ended += "first "; });
  of_device.drain(*device, [&] { ended += "second "; });
  EXPECT_EQ(ended, "");
  const std::function<void()> over = line.drains();
  EXPECT_EQ(of_driver.events, "drain ");
  EXPECT_EQ(ended, "");
  over();
  EXPECT_EQ(ended, "first second ");
  over();
  EXPECT_EQ(ended, "first second ") << "once";
}

TEST_F(TappedLineTest, ADrainEndsWithItsDevice) {
  std::string ended;
  const auto note = [&] { ended += "x"; };
  of_device.drain(*device, note);
  EXPECT_EQ(ended, "x") << "of one that is not up";
  open_all();
  of_device.drain(*device, note);
  device->close();
  EXPECT_EQ(ended, "xx");
  device->open();
  of_device.drain(*device, note);
  line.lost("gone");
  EXPECT_EQ(ended, "xxx");
  of_device.drain(*device, note);
  EXPECT_EQ(ended, "xxxx");
}

TEST_F(TappedLineTest, EitherMayGoFirst) {
  open_all();
  const std::function<void()> over = line.drains();
  driver.reset();
  device.reset();
  line.wrote(test::bytes_of("x"));
  line.got(test::bytes_of("x"));
  line.made(settings);
  line.driver_did(line::Flush{FlushQueue::out});
  line.driver_did(LineSignal{Name::dtr, true});
  line.device_did(LineSignal{Name::cts, true});
  line.lost("gone");
  over();
  line.drains()();
  line.closed();
  line.opened("/dev/ttyUSB1", settings);
  EXPECT_EQ(of_device.events, "");
  EXPECT_EQ(of_driver.events, "drain ");
}

TEST(TappedLine, ItsPortsOutliveIt) {
  PortLog log;
  auto line = std::make_unique<TappedLine>("/dev/given");
  const std::unique_ptr<Port> driver = line->driver_port();
  const std::unique_ptr<Port> device = line->device_port();
  driver->listen(log);
  device->listen(log);
  line->opened("/dev/ttyUSB0", {});
  line.reset();
  driver->open();
  device->open();
  EXPECT_EQ(log.events, "up ") << "the device's alone";
  EXPECT_EQ(driver->place().path, "");
  EXPECT_EQ(device->name(), "the command's device");
  EXPECT_FALSE(device->settings().has_value());
  EXPECT_FALSE(device->identity().has_value());
}

}  // namespace
}  // namespace porttape
