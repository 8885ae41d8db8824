// A device that does not do every rate. A pty does, so this program has an ioctl() in which ptys do not: of
// the rates above kMostBaud nothing is set, as an 8250 would.

#include <asm/termbits.h>
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

namespace {
constexpr unsigned kMostBaud = 100'000'000;
}

extern "C" int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list arguments;
  va_start(arguments, request);
  void* const argument = va_arg(arguments, void*);
  va_end(arguments);
  if (request == TCSETS2 && static_cast<const termios2*>(argument)->c_ospeed > kMostBaud) return 0;
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
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(baud(), 4800U);
  EXPECT_EQ(port->settings()->baud, 4800U);
  EXPECT_NE(book.text().find("does not do 200000000 baud"), std::string::npos) << book.text();
}

TEST_F(SerialRateTest, ARateThatTheDeviceDoesNotDoIsAnErrorAndChangesNothing) {
  port->open();
  EXPECT_FALSE(port->apply({.baud = 2 * kMostBaud}).has_value());
  EXPECT_EQ(baud(), 4800U);
  EXPECT_EQ(port->settings()->baud, 4800U);
}

}  // namespace
}  // namespace porttape
