#include <fcntl.h>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <sys/file.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tty/settings_queue.hpp"
#include "libport/tty/tty.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/tty/serial_rig.hpp"

namespace porttape {
namespace {

// The settings of a port that is up, seen at the device.
class SerialSettingsTest : public SerialPortTest {
 protected:
  void start(std::map<std::string, std::string> options = {{"baud", "4800"}}) {
    make_port(std::move(options));
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
    ASSERT_EQ(log.events, "up ");
  }
  void apply(const LineSettings& settings) { ASSERT_TRUE(port->apply(settings).has_value()); }
  [[nodiscard]] unsigned baud() const {
    const Result<ShownSettings> shown = shown_settings(device.get());
    return shown ? shown->settings.baud.value_or(1) : 1;
  }
  void until_baud(unsigned wanted) {
    run_until(loop, [&] { return baud() == wanted; });
    EXPECT_EQ(baud(), wanted);
  }
  // What the device has got, once it satisfies `done`. Its end of the line is watched, since the kernel
  // passes bytes on when it likes, and nothing else may be left to wake the loop then.
  std::string received_until(const std::function<bool(const std::string&)>& done) {
    std::string all;
    FdWatch watch(loop, device.get(), [&] {
      char buffer[4096];
      const ssize_t size = ::read(device.get(), buffer, sizeof buffer);
      if (size > 0) all.append(buffer, static_cast<std::size_t>(size));
    });
    watch.watch_readable(true);
    run_until(loop, [&] { return done(all); });
    return all;
  }
};

// Until the line stands still: one that is full for a moment may have room the next, as the kernel passes
// some bytes on by itself.
void fill(Port& port) {
  const std::string block(4096, 'b');
  while (!port.congested()) port.write(as_bytes(block));
  for (int i = 0; i < 4; ++i) port.write(as_bytes(block));
}

TEST_F(SerialSettingsTest, AreTheOnesAskedForAndReachTheDevice) {
  start();
  apply({.baud = 250000, .stop_bits = 2, .hw_flow = true, .sw_flow = true});
  EXPECT_EQ(port->settings()->baud, 250000U);
  until_baud(250000);
  const Result<ShownSettings> shown = shown_settings(device.get());
  EXPECT_EQ(shown->settings.stop_bits, 2U);
  EXPECT_EQ(shown->settings.hw_flow, true);
  EXPECT_EQ(shown->settings.sw_flow, true);
  apply({.baud = 0});
  until_baud(0);
}

TEST_F(SerialSettingsTest, BytesWrittenAfterAChangeGoOutAfterIt) {
  start();
  port->write(as_bytes("old "));
  apply({.baud = 1200});
  port->write(as_bytes("new"));
  EXPECT_TRUE(port->congested());
  EXPECT_EQ(port->unread_by_peer(), 7U - 4U) << "the device has four";
  EXPECT_EQ(received_until([](const std::string& all) { return all.ends_with("new"); }), "old new");
  EXPECT_EQ(baud(), 1200U);
  run_until(loop, [&] { return !port->congested(); });
  EXPECT_EQ(log.events, "up drained ");
}

TEST_F(SerialSettingsTest, SeveralChangesAndBytesKeepTheirOrder) {
  start();
  std::string sent;
  for (const unsigned rate : {1200U, 2400U, 9600U, 19200U}) {
    apply({.baud = 300});
    apply({.baud = rate});
    port->write(as_bytes("at " + std::to_string(rate) + " "));
    sent += "at " + std::to_string(rate) + " ";
  }
  EXPECT_EQ(received_until([&](const std::string& all) { return all.size() >= sent.size(); }), sent);
  EXPECT_EQ(baud(), 19200U);
}

TEST_F(SerialSettingsTest, AChangeWaitsForBytesThatTheDeviceHasNotTaken) {
  start();
  fill(*port);
  apply({.baud = 1200});
  port->write(as_bytes("new"));
  EXPECT_EQ(baud(), 4800U);
  const std::string all = received_until([](const std::string& got) { return got.ends_with("new"); });
  EXPECT_TRUE(all.ends_with("bnew"));
  EXPECT_EQ(baud(), 1200U);
}

// Hardware flow control that is wrongly on may be why they wait.
TEST_F(SerialSettingsTest, FlowControlDoesNotWaitForThem) {
  start();
  fill(*port);
  apply({.baud = 4800, .hw_flow = true});
  run_until(loop, [&] { return shown_settings(device.get())->settings.hw_flow == true; });
  EXPECT_TRUE(port->congested());
}

TEST_F(SerialSettingsTest, OneThatIsCongestedDrainsAfterAChangeWithoutBytes) {
  start();
  const std::string block(4096, 'b');
  while (!port->congested()) port->write(as_bytes(block));
  apply({.baud = 1200});
  const Reader reader(loop, device.get());
  run_until(loop, [&] { return log.events == "up drained "; });
  EXPECT_EQ(log.events, "up drained ");
  EXPECT_EQ(baud(), 1200U);
  EXPECT_FALSE(port->congested());
}

TEST_F(SerialSettingsTest, AChangeWithoutBytesIsNoNews) {
  start();
  apply({.baud = 1200});
  port->write(as_bytes("x"));
  run_until(loop, [&] { return log.events == "up drained "; });
  apply({.baud = 2400});
  until_baud(2400);
  apply({.baud = 9600});
  until_baud(9600);
  EXPECT_EQ(log.events, "up drained ");
}

TEST_F(SerialSettingsTest, ALineThatStandsStillIsChangedAllTheSame) {
  start();
  fill(*port);
  EXPECT_TRUE(port->congested());
  apply({.baud = 1200});
  until_baud(1200);
  EXPECT_TRUE(port->congested());
}

TEST_F(SerialSettingsTest, TheUsersOwnReturnAtTheClose) {
  start();
  apply({.baud = 1200});
  port->close();
  EXPECT_EQ(port->settings()->baud, 4800U);
  run_until(loop, [&] {
    const UniqueFd probe(::open(path.c_str(), O_RDWR | O_NOCTTY));
    return ::flock(probe.get(), LOCK_EX | LOCK_NB) == 0;
  });
  EXPECT_EQ(baud(), 4800U);
}

TEST_F(SerialSettingsTest, AChangeUnderWayAtTheCloseIsNotTheNextSessions) {
  start();
  std::string events = log.events;
  for (int i = 0; i < 50; ++i) {
    apply({.baud = 1200});
    if (i % 2 == 0) until_baud(1200);  // made, and not heard of
    port->close();
    port->open();
    events += "up ";
    run_until(loop, [&] { return log.events == events; });
    ASSERT_EQ(port->settings()->baud, 4800U);
    ASSERT_EQ(baud(), 4800U);
  }
}

TEST_F(SerialSettingsTest, TheUsersOwnReturnToOneThatIsAlwaysOpen) {
  start({{"baud", "4800"}, {"alwaysopen", "1"}});
  apply({.baud = 1200});
  until_baud(1200);
  port->close();
  until_baud(4800);
}

TEST_F(SerialSettingsTest, KeepLeavesTheDeviceAlone) {
  start({{"baud", "4800"}, {"settings", "keep"}});
  apply({.baud = 1200});
  EXPECT_EQ(port->settings()->baud, 4800U);
  port->write(as_bytes("x"));
  EXPECT_FALSE(port->congested());
  EXPECT_EQ(baud(), 4800U);
}

TEST_F(SerialSettingsTest, ADeviceThatComesBackGetsTheLastOnes) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "ttyBack").string();
  std::filesystem::create_symlink(path, link);
  start({{"device", link}, {"alwaysopen", "1"}, {"baud", "4800"}});
  apply({.baud = 1200});
  until_baud(1200);
  UniqueFd other(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(other.get());
  ::unlockpt(other.get());
  device.reset();
  run_until(loop, [&] { return log.events == "up interrupted "; });
  EXPECT_EQ(log.events, "up interrupted ");
  std::filesystem::remove(link);
  std::filesystem::create_symlink(::ptsname(other.get()), link);
  run_until(loop, [&] { return log.events == "up interrupted resumed "; });
  device = std::move(other);
  EXPECT_EQ(baud(), 1200U);
}

}  // namespace
}  // namespace porttape
