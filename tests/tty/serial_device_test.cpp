// How a SerialPort finds and takes its device, and what it says of one that it cannot take.

#include <cstddef>
#include <fcntl.h>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"
#include "tests/tty/serial_rig.hpp"

namespace porttape {
namespace {

class SerialDeviceTest : public SerialPortTest {
 protected:
  void start(std::map<std::string, std::string> options = {}) {
    make_port(std::move(options));
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
    ASSERT_EQ(log.events, "up ");
  }
  [[nodiscard]] std::size_t times_told(std::string_view text) const {
    const std::string all = book.text();
    std::size_t count = 0;
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }
};

TEST_F(SerialDeviceTest, WhatItIsInsteadIsSaid) {
  const test::TempDir dir;
  const std::string file = dir / "file";
  test::write_file(file, {});
  EXPECT_EQ(prepare_error(file).message, "device '" + file + "' is a file, not a serial device");
  EXPECT_EQ(prepare_error(dir.path().string()).message,
            "device '" + dir.path().string() + "' is a folder, not a serial device");
  EXPECT_EQ(prepare_error("/dev/null").message, "device '/dev/null' is something else, not a serial device");
  EXPECT_EQ(prepare_error(dir / "none").message,
            "device '" + (dir / "none") +
                "': No such file or directory; is it plugged in? (--wait-device waits for it)");
}

TEST_F(SerialDeviceTest, WhatItHasBecomeByTheOpenIsNotTaken) {
  const test::TempDir dir;
  const std::string link = dir / "ttyX";
  std::filesystem::create_symlink(path, link);
  make_port({{"device", link}});
  ASSERT_TRUE(port->prepare().has_value());
  std::filesystem::remove(link);
  test::write_file(link, {});
  port->open();
  EXPECT_EQ(log.events, "failed ");
  EXPECT_EQ(log.error.code, Errc::device_missing);
  EXPECT_EQ(log.error.message, "device '" + link + "' is not a serial device");
}

TEST_F(SerialDeviceTest, OneThatIsMissingIsSaidOnceWhereItIsWaitedFor) {
  const test::TempDir dir;
  const std::string missing = dir / "none";
  make_port({{"device", missing}, {"wait", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  EXPECT_EQ(times_told("device '" + missing + "': No such file or directory; waiting for it"), 1U);
}

TEST_F(SerialDeviceTest, OneThatAnotherProgramHasIsBusy) {
  const UniqueFd other(::open(path.c_str(), O_RDWR | O_NOCTTY));
  ASSERT_EQ(::flock(other.get(), LOCK_EX | LOCK_NB), 0);
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.error.code, Errc::device_missing);
  EXPECT_EQ(log.error.message, "device '" + path + "' is busy; another program has it open");
}

TEST_F(SerialDeviceTest, ItIsItsOwnAsLongAsItIsOpen) {
  const UniqueFd other(::open(path.c_str(), O_RDWR | O_NOCTTY));
  const auto exclusive = [&other] {
    int on = -1;
    EXPECT_EQ(::ioctl(other.get(), TIOCGEXCL, &on), 0);
    return on;
  };
  EXPECT_EQ(exclusive(), 0);
  start();
  EXPECT_EQ(exclusive(), 1);
  port->close();
  EXPECT_EQ(exclusive(), 0) << "a tty that another program holds open would keep it";
}

TEST_F(SerialDeviceTest, WhatCameBeforeTheOpenIsNotRead) {
  const UniqueFd other(::open(path.c_str(), O_RDWR | O_NOCTTY));
  ASSERT_EQ(::write(device.get(), "old\n", 4), 4);
  start();
  ASSERT_EQ(::write(device.get(), "new", 3), 3);
  run_until(loop, [&] { return log.data.ends_with("new"); });
  EXPECT_EQ(log.data, "new");
}

TEST_F(SerialDeviceTest, WithoutALineWhatIsWrittenIsDropped) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->write(as_bytes("abc"));
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(port->waiting()->write_some(as_bytes("abc")), 0U);
  EXPECT_EQ(port->unread_by_peer(), 0U);
  EXPECT_TRUE(port->waiting()->discard());
}

TEST_F(SerialDeviceTest, OneForReadingOnlyDropsWhatIsWritten) {
  start({{"readonly", "1"}});
  port->write(as_bytes("abc"));
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(port->waiting()->write_some(as_bytes("abc")), 3U) << "nobody is to wait for it";
  char byte = 0;
  EXPECT_EQ(::read(device.get(), &byte, 1), -1);
  ASSERT_EQ(::write(device.get(), "x", 1), 1);
  run_until(loop, [&] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "x");
}

TEST_F(SerialDeviceTest, WhatWasNotSentAtTheCloseIsTold) {
  start();
  const std::string block(4096, 'b');
  std::size_t written = 0;
  for (; !port->congested(); written += block.size()) port->write(as_bytes(block));
  const std::size_t unsent = port->unread_by_peer().value_or(0);
  EXPECT_GT(unsent, 0U);
  EXPECT_LT(unsent, written);
  port->close();
  EXPECT_EQ(log.dropped, unsent);
}

TEST_F(SerialDeviceTest, WhatIsDiscardedIsNotSentAndNotTold) {
  start();
  const std::string block(4096, 'b');
  while (!port->congested()) port->write(as_bytes(block));
  EXPECT_TRUE(port->waiting()->discard());
  EXPECT_EQ(port->unread_by_peer(), 0U);
  port->close();
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(SerialDeviceTest, ModemLinesThatItHasNotAreToldOnce) {
  start({{"dtr", "on"}, {"rts", "off"}});
  port->close();
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  EXPECT_EQ(times_told("option 'dtr': setting a modem line: Inappropriate ioctl for device"), 1U);
  EXPECT_EQ(times_told("option 'rts': setting a modem line: Inappropriate ioctl for device"), 1U);
}

TEST_F(SerialDeviceTest, ModemLinesAreLeftAloneByDefault) {
  start();
  EXPECT_EQ(times_told("setting a modem line"), 0U);
}

TEST_F(SerialDeviceTest, WhatItDoesNotTakeIsToldOnce) {
  start({{"parity", "even"}});
  port->close();
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  EXPECT_EQ(times_told("the device did not take: parity"), 1U);
}

TEST_F(SerialDeviceTest, WhatIsThereIsReadOnRequestUnlessReadingIsOff) {
  start();
  ASSERT_EQ(::write(device.get(), "last", 4), 4);
  while (log.data.size() < 4) port->read_pending();
  EXPECT_EQ(log.data, "last");
  port->set_reading(false);
  ASSERT_EQ(::write(device.get(), "more", 4), 4);
  port->read_pending();
  EXPECT_EQ(log.data, "last");
}

TEST_F(SerialDeviceTest, AHangUpWithoutASessionIsNoNews) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->hang_up(true);
  while (loop.poll_one()) {
  }
  EXPECT_EQ(log.events, "");
}

TEST_F(SerialDeviceTest, APtyHasNoIdentity) {
  start();
  EXPECT_EQ(port->identity(), std::nullopt);
}

}  // namespace
}  // namespace porttape
