#include "libport/tty/serial_port.hpp"

#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <memory>
#include <poll.h>
#include <sys/file.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tty/pty.hpp"
#include "libport/tty/types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

// The device is the slave of a pty whose master the test holds.
class SerialPortTest : public testing::Test {
 protected:
  SerialPortTest() : device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    ::grantpt(device.get());
    ::unlockpt(device.get());
    path = ::ptsname(device.get());
  }

  void make_port(std::map<std::string, std::string> options = {}) {
    options.try_emplace("device", path);
    const Result<PortOptions> checked = check_options(PortOptions{&type, std::move(options)});
    const Result<PortSpec> spec = PortSpec::read(*checked);
    port = std::make_unique<SerialPort>(PortContext{&loop, book.log()}, spec->common(),
                                        *spec->get<SerialOptions>());
    port->listen(log);
  }
  Error prepare_error(const std::string& device_path) {
    make_port({{"device", device_path}});
    const Result<void> prepared = port->prepare();
    EXPECT_FALSE(prepared.has_value()) << device_path;
    return prepared ? Error{} : prepared.error();
  }

  const PortType type = serial_type();
  UniqueFd device;
  std::string path;
  Loop loop;
  LogBook book;
  PortLog log;
  std::unique_ptr<SerialPort> port;
};

TEST_F(SerialPortTest, AStandardRateIsWhatOtherProgramsSee) {
  for (const auto& [baud, code] : {std::pair("9600", B9600), std::pair("115200", B115200)}) {
    make_port({{"baud", baud}});
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
    termios tio{};
    ASSERT_EQ(::tcgetattr(device.get(), &tio), 0);
    EXPECT_EQ(::cfgetospeed(&tio), static_cast<speed_t>(code));
    EXPECT_EQ(::cfgetispeed(&tio), static_cast<speed_t>(code));
    port.reset();
    run_until(loop, [&] {  // closed elsewhere
      const UniqueFd probe(::open(path.c_str(), O_RDWR | O_NOCTTY));
      return ::flock(probe.get(), LOCK_EX | LOCK_NB) == 0;
    });
  }
}

TEST_F(SerialPortTest, AHangUpIsTold) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->hang_up(true);
  EXPECT_EQ(log.events, "up ");
  run_until(loop, [&] { return log.events == "up hung_up "; });
}

TEST_F(SerialPortTest, OneThatWasHungUpComesUpAgainByTheNextOpenOnly) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->hang_up(true);
  const auto closed = [this] {
    pollfd line{device.get(), 0, 0};
    return ::poll(&line, 1, 0) > 0 && (line.revents & POLLHUP) != 0;
  };
  run_until(loop, [&] { return log.events == "up hung_up " && closed(); });
  // The port hears of the close before a job that begins later is done.
  bool heard = false;
  ASSERT_TRUE(loop.run_elsewhere(
      Workers::Strand(), [] {}, [&heard] { heard = true; }));
  run_until(loop, [&heard] { return heard; });
  EXPECT_EQ(log.events, "up hung_up ");
  port->close();
  port->open();
  run_until(loop, [&] { return log.events == "up hung_up up "; });
}

TEST_F(SerialPortTest, OneThatIsForWritingOnlyIsNotLostWhenTheDeviceSends) {
  make_port({{"writeonly", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  ASSERT_EQ(::write(device.get(), "noise", 5), 5);
  port->write(as_bytes("ask"));
  while (loop.poll_one()) {
  }
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.data, "");
  char buffer[64];
  EXPECT_EQ(::read(device.get(), buffer, sizeof buffer), 3);
}

TEST_F(SerialPortTest, BytesGoBothWaysUnchanged) {
  make_port({{"baud", "250000"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.events, "up ");
  port->write(as_bytes("ask\r\n\x03"));
  char buffer[64];
  ASSERT_EQ(::read(device.get(), buffer, sizeof buffer), 6);
  EXPECT_EQ(std::string(buffer, 6), "ask\r\n\x03");
  ASSERT_EQ(::write(device.get(), "answer\r\x11", 8), 8);
  run_until(loop, [&] { return log.data.size() >= 8; });
  EXPECT_EQ(log.data, "answer\r\x11");
}

TEST_F(SerialPortTest, WhatIsNotASerialDeviceIsNamed) {
  const test::TempDir dir;
  const std::string file = (dir.path() / "file").string();
  std::ofstream(file) << "x";
  for (const std::string& wrong :
       {file, dir.path().string(), std::string("/dev/null"), std::string("/dev/no-such-tty")}) {
    const Error error = prepare_error(wrong);
    EXPECT_EQ(error.code, Errc::device_missing);
    EXPECT_NE(error.message.find(wrong), std::string::npos) << error.message;
  }
}

TEST_F(SerialPortTest, ABusyDeviceFailsToOpen) {
  const UniqueFd other(::open(path.c_str(), O_RDWR | O_NOCTTY));
  ASSERT_EQ(::flock(other.get(), LOCK_EX | LOCK_NB), 0);
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.events, "failed ");
  EXPECT_NE(log.error.message.find("busy"), std::string::npos) << log.error.message;
}

TEST_F(SerialPortTest, ADeviceThatGoesAwayIsLost) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  device.reset();
  run_until(loop, [&] { return log.events == "up lost "; });
  EXPECT_EQ(log.error.code, Errc::device_lost);
}

TEST_F(SerialPortTest, MayBeOpenedAgainAtOnce) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->close();
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  EXPECT_EQ(log.events, "up up ");
}

TEST_F(SerialPortTest, AlwaysOpenKeepsTheDeviceThroughClose) {
  make_port({{"alwaysopen", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->close();
  ASSERT_EQ(::write(device.get(), "on", 2), 2);
  run_until(loop, [&] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "on");
}

TEST_F(SerialPortTest, AlwaysOpenComesBackAfterAnUnplug) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "ttyBack").string();
  std::filesystem::create_symlink(path, link);
  make_port({{"device", link}, {"alwaysopen", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  const UniqueFd other(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(other.get());
  ::unlockpt(other.get());
  device.reset();
  run_until(loop, [&] { return log.events == "up interrupted "; });
  std::filesystem::remove(link);
  std::filesystem::create_symlink(::ptsname(other.get()), link);
  run_until(loop, [&] { return log.events == "up interrupted resumed "; });
  port->write(as_bytes("x"));
  char byte = 0;
  EXPECT_EQ(::read(other.get(), &byte, 1), 1);
}

TEST_F(SerialPortTest, WaitsForADeviceThatIsMissing) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "ttyLater").string();
  make_port({{"device", link}, {"wait", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.events, "");
  std::filesystem::create_symlink(path, link);
  run_until(loop, [&] { return log.events == "up "; });
}

TEST_F(SerialPortTest, ASlowDeviceCongestsAndDrains) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  const std::string block(4096, 'b');
  while (!port->congested()) port->write(as_bytes(block));
  const Reader reader(loop, device.get());
  run_until(loop, [&] { return log.events == "up drained "; });
  EXPECT_EQ(log.events, "up drained ");
}

// The close stands for one that waits in the kernel: it is the loop's thread that must not do it.
TEST_F(SerialPortTest, ClosesOnAnotherThreadAndOpensAgainBehindIt) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->close();
  port->open();
  EXPECT_EQ(log.events, "up ") << "the old descriptor holds the device's lock";
  run_until(loop, [&] { return log.events == "up up "; });
}

TEST_F(SerialPortTest, AnUnpluggedDeviceIsReleasedAtOnce) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  device.reset();
  run_until(loop, [&] { return log.events == "up lost "; });
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    EXPECT_FALSE(std::filesystem::read_symlink(entry, gone).string().starts_with(path)) << path;
  }
}

}  // namespace
}  // namespace porttape
