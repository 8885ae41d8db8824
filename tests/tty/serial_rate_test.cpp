// A device that does not do every rate, and one that takes no bytes. A pty does, so this program has an
// ioctl() in which ptys do not: of the rates above kMostBaud nothing is set, as an 8250 would, and unsent
// bytes are there while `stuck_bytes` says so. A PlayedTty has its ioctls from it too.

#include <asm/termbits.h>
#include <atomic>
#include <cstdarg>
#include <fcntl.h>
#include <memory>
#include <string>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/tty/pty.hpp"
#include "libport/tty/serial_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/tty/played_ioctl.hpp"

namespace {
constexpr unsigned kMostBaud = 100'000'000;
std::atomic<int> stuck_bytes = 0;
}  // namespace

extern "C" int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list arguments;
  va_start(arguments, request);
  void* const argument = va_arg(arguments, void*);
  va_end(arguments);
  if (const auto* const play = porttape::PlayedTty::current();
      play != nullptr && fd == porttape::PlayedTty::kFd)
    return (*play)(request, argument);
  if (request == TCSETS2 && static_cast<const termios2*>(argument)->c_ospeed > kMostBaud) return 0;
  if (request == TIOCOUTQ && stuck_bytes > 0) {
    *static_cast<int*>(argument) = stuck_bytes;
    return 0;
  }
  return static_cast<int>(::syscall(SYS_ioctl, fd, request, argument));
}

namespace porttape {
namespace {

class SerialRateTest : public testing::Test {
 protected:
  SerialRateTest() : device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    ::grantpt(device.get());
    ::unlockpt(device.get());
    port = std::make_unique<SerialPort>(
        PortContext{&loop, book.log()}, CommonOptions{},
        SerialOptions{.device = ::ptsname(device.get()), .settings = {.baud = 4800}});
    port->listen(log);
  }
  unsigned baud() const {
    termios2 tio{};
    EXPECT_EQ(::ioctl(device.get(), TCGETS2, &tio), 0);
    return tio.c_ospeed;
  }

  UniqueFd device;
  Loop loop;
  LogBook book;
  PortLog log;
  std::unique_ptr<SerialPort> port;
};

TEST_F(SerialRateTest, SettingsGivenBeforeTheOpenAreItsOwn) {
  EXPECT_TRUE(port->apply({.baud = 300}).has_value());
  EXPECT_EQ(port->settings()->baud, 300U);
  port->open();
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(baud(), 300U);
  EXPECT_EQ(port->settings()->baud, 300U);
}

TEST_F(SerialRateTest, ARateThatTheOpenedDeviceDoesNotDoChangesNothing) {
  EXPECT_TRUE(port->apply({.baud = 2 * kMostBaud}).has_value());
  port->open();
  EXPECT_EQ(log.events, "up settings ");
  EXPECT_EQ(log.settings.baud, 4800U);
  EXPECT_EQ(baud(), 4800U);
  EXPECT_EQ(port->settings()->baud, 4800U);
  EXPECT_NE(book.text().find("does not do 200000000 baud"), std::string::npos) << book.text();
}

TEST_F(SerialRateTest, ARateThatTheDeviceDoesNotDoChangesNothingAndIsTold) {
  port->open();
  for (unsigned i = 2; i < 10; ++i) {
    log.events.clear();
    EXPECT_TRUE(port->apply({.baud = i * kMostBaud}).has_value());
    run_until(loop, [&] { return log.events.starts_with("settings "); });
    EXPECT_EQ(log.settings.baud, 4800U);
    EXPECT_EQ(baud(), 4800U);
    EXPECT_EQ(port->settings()->baud, 4800U);
  }
  const std::string text = book.text();
  const auto told = text.find("does not do 200000000 baud");
  EXPECT_NE(told, std::string::npos) << text;
  EXPECT_EQ(text.find("does not do", told + 1), std::string::npos) << "told once";
}

// A hang-up (B0) behind the last bytes, and then the close: they have the time that they need.
TEST_F(SerialRateTest, BytesBeforeAHangUpAreNotDroppedAtTheClose) {
  port->open();
  stuck_bytes = 5;
  EXPECT_TRUE(port->apply({.baud = 0}).has_value());
  port->close();
  bool over = false;
  Timer later(loop, [&over] { over = true; });
  later.set_after(std::chrono::milliseconds(100));
  run_until(loop, [&over] { return over; });
  stuck_bytes = 0;
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  EXPECT_EQ(log.dropped, 0U);
  EXPECT_EQ(baud(), 4800U);
}

// Its flow control has stopped it, and settings without that would pour them out.
TEST_F(SerialRateTest, WhatADeviceDoesNotTakeBeforeTheNextOpenIsDroppedAndTold) {
  port->open();
  EXPECT_TRUE(port->apply({.baud = 9600, .sw_flow = true}).has_value());
  port->write(as_bytes("x"));  // goes out once the change is made
  run_until(loop, [&] { return !port->congested(); });
  EXPECT_EQ(baud(), 9600U);
  stuck_bytes = 5;
  port->close();
  EXPECT_EQ(log.dropped, 0U) << "the device has half a minute";
  port->open();
  run_until(loop, [&] { return log.events == "up drained up "; });
  stuck_bytes = 0;
  EXPECT_EQ(log.dropped, 5U);
  EXPECT_EQ(baud(), 4800U);
}

}  // namespace
}  // namespace porttape
