#include "libport/tty/serial_port.hpp"

#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <memory>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tty/pty.hpp"
#include "libport/tty/tty.hpp"
#include "libport/tty/types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/tty/serial_rig.hpp"

namespace porttape {
namespace {

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
  const std::string file = dir / "file";
  const std::string folder = dir.path().string();
  std::ofstream(file) << "x";
  const std::pair<std::string, std::string> wrong[] = {
      {file, "device '" + file + "' is a file, not a serial device"},
      {folder, "device '" + folder + "' is a folder, not a serial device"},
      {"/dev/null", "device '/dev/null' is something else, not a serial device"},
      {"/dev/no-such-tty",
       "device '/dev/no-such-tty': No such file or directory; is it plugged in? (--wait-device waits for "
       "it)"},
  };
  for (const auto& [name, message] : wrong) {
    const Error error = prepare_error(name);
    EXPECT_EQ(error.code, Errc::device_missing);
    EXPECT_EQ(error.message, message);
  }
}

TEST_F(SerialPortTest, AMissingDeviceIsWaitedForWhereThatIsWanted) {
  make_port({{"device", "/dev/no-such-tty"}, {"wait", "1"}});
  EXPECT_TRUE(port->prepare().has_value());
  EXPECT_NE(book.text().find("device '/dev/no-such-tty': No such file or directory; waiting for it"),
            std::string::npos)
      << book.text();
}

TEST_F(SerialPortTest, OneThatIsGoneWhenItIsOpenedFails) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  device.reset();
  port->open();
  EXPECT_EQ(log.events, "failed ");
  EXPECT_EQ(log.error.code, Errc::device_missing);
  EXPECT_EQ(
      log.error.message,
      "device '" + path + "': No such file or directory; is it plugged in? (--wait-device waits for it)");
}

TEST_F(SerialPortTest, ABusyDeviceFailsToOpen) {
  const UniqueFd other(::open(path.c_str(), O_RDWR | O_NOCTTY));
  ASSERT_EQ(::flock(other.get(), LOCK_EX | LOCK_NB), 0);
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.events, "failed ");
  EXPECT_EQ(log.error.message, "device '" + path + "' is busy; another program has it open");
}

// The line is worth more than the lock.
TEST_F(SerialPortTest, ALockThatCannotBeMadeIsToldOnceAndCostsNoLine) {
  make_port({{"uucplock", "1"}});
  std::filesystem::remove_all(locks.path());
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->close();
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  const std::string told = port->name() + ": option 'uucplock': ";
  EXPECT_NE(book.text().find(told), std::string::npos) << book.text();
  EXPECT_EQ(book.text().find(told), book.text().rfind(told)) << "once";
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

TEST_F(SerialPortTest, ADeviceThatALivingProcessHasLockedIsBusy) {
  std::ofstream(lock_of(path)) << ::getppid() << "\n";
  const Error error = prepare_error(path);
  EXPECT_EQ(error.code, Errc::device_missing);
  EXPECT_TRUE(error.message.starts_with("device '" + path + "' is busy: ")) << error.message;
  EXPECT_NE(error.message.find(std::to_string(::getppid())), std::string::npos) << error.message;
}

TEST_F(SerialPortTest, OneThatIsLockedLaterFailsToOpenUntouched) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  termios before{};
  ASSERT_EQ(::tcgetattr(device.get(), &before), 0);
  std::ofstream(lock_of(path)) << ::getppid() << "\n";
  port->open();
  EXPECT_EQ(log.events, "failed ");
  termios after{};
  ASSERT_EQ(::tcgetattr(device.get(), &after), 0);
  EXPECT_EQ(before.c_lflag, after.c_lflag);
  std::filesystem::remove(lock_of(path));
  port->close();
  port->open();
  EXPECT_EQ(log.events, "failed up ");
}

TEST_F(SerialPortTest, WaitWaitsForTheEndOfALock) {
  std::ofstream(lock_of(path)) << ::getppid() << "\n";
  make_port({{"wait", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.events, "");
  std::filesystem::remove(lock_of(path));
  run_until(loop, [&] { return log.events == "up "; });
}

TEST_F(SerialPortTest, ALockIsMadeOnRequestAndGoesWithTheOpenDevice) {
  const auto no_lock = [this] { return std::filesystem::is_empty(locks.path()); };
  make_port({{"uucplock", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  for (int n = 0; n < 3; ++n) {
    EXPECT_TRUE(no_lock());
    port->open();
    EXPECT_TRUE(std::filesystem::exists(lock_of(path)));
    port->close();
    run_until(loop, no_lock);
  }
  port->open();
  run_until(loop, [this] { return log.events.ends_with("up "); });
  port.reset();
  EXPECT_TRUE(no_lock());
}

TEST_F(SerialPortTest, ALockIsMadeOnlyOnRequest) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_TRUE(std::filesystem::is_empty(locks.path()));
}

TEST_F(SerialPortTest, ALockThatCannotBeMadeCostsNoLineAndIsToldOnce) {
  std::filesystem::remove(locks.path());
  make_port({{"uucplock", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  std::string expected;
  for (int n = 0; n < 3; ++n) {
    port->open();
    expected += "up ";
    run_until(loop, [&] { return log.events == expected; });
    port->close();
  }
  const std::string told = book.text();
  EXPECT_NE(told.find("uucplock"), std::string::npos) << told;
  EXPECT_EQ(told.find("uucplock"), told.rfind("uucplock")) << told;
}

// A device that is another pty each time it is plugged in, found by a link as under /dev/serial/by-id.
class PluggedDevice {
 public:
  explicit PluggedDevice(std::filesystem::path link) : link_(std::move(link)) {}

  void plug_in() {
    end.reset(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
    ::grantpt(end.get());
    ::unlockpt(end.get());
    std::filesystem::create_directories(link_.parent_path());
    std::filesystem::create_symlink(::ptsname(end.get()), link_);
  }
  // With the folder of the link, and the one above.
  void unplug() {
    end.reset();
    std::filesystem::remove_all(link_.parent_path().parent_path());
  }

  UniqueFd end;

 private:
  std::filesystem::path link_;
};

class UnpluggedPortTest : public SerialPortTest {
 protected:
  UnpluggedPortTest() : link(dir.path() / "serial" / "by-id" / "usb-laser"), plugged(link) {}

  void start(std::map<std::string, std::string> options) {
    plugged.plug_in();
    options["device"] = link.string();
    make_port(std::move(options));
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
    ASSERT_EQ(log.events, "up ");
  }
  // Whether this process has such a descriptor open.
  static bool holds(const std::string& name) {
    for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
      std::error_code gone;
      if (std::filesystem::read_symlink(entry, gone).string().starts_with(name)) return true;
    }
    return false;
  }

  const test::TempDir dir;
  const std::filesystem::path link;
  PluggedDevice plugged;
};

TEST_F(UnpluggedPortTest, AlwaysOpenFindsItUnderAnotherNameBehindAFolderThatVanished) {
  start({{"alwaysopen", "1"}, {"baud", "57600"}});
  std::string expected = "up ";
  for (int n = 0; n < 3; ++n) {
    plugged.unplug();
    expected += "interrupted ";
    run_until(loop, [&] { return log.events == expected; });
    plugged.plug_in();
    expected += "resumed ";
    run_until(loop, [&] { return log.events == expected; });
    ASSERT_EQ(log.events, expected);
    termios tio{};
    ASSERT_EQ(::tcgetattr(plugged.end.get(), &tio), 0);
    EXPECT_EQ(::cfgetospeed(&tio), static_cast<speed_t>(B57600)) << "with its settings";
    port->write(as_bytes("x"));
    char byte = 0;
    EXPECT_EQ(::read(plugged.end.get(), &byte, 1), 1);
  }
}

TEST_F(UnpluggedPortTest, WaitWaitsForItsFolders) {
  make_port({{"device", link.string()}, {"wait", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  EXPECT_EQ(log.events, "");
  plugged.plug_in();
  run_until(loop, [&] { return log.events == "up "; });
  plugged.unplug();
  run_until(loop, [&] { return log.events == "up lost "; });
  port->close();
  port->open();
  EXPECT_EQ(log.events, "up lost ");
  plugged.plug_in();
  run_until(loop, [&] { return log.events == "up lost up "; });
}

TEST_F(UnpluggedPortTest, ADeadDeviceIsNotHeldThoughNobodyReadsIt) {
  for (const auto& [option, events] :
       {std::pair("alwaysopen", "up interrupted "), {"readwrite", "up lost "}}) {
    log.events.clear();
    start({{option, "1"}});
    const std::string name = std::filesystem::read_symlink(link).string();
    EXPECT_TRUE(holds(name));
    port->set_reading(false);  // the driver is slow
    plugged.unplug();
    run_until(loop, [&, wanted = events] { return log.events == wanted; });
    EXPECT_FALSE(holds(name));
  }
}

TEST_F(UnpluggedPortTest, ADeadDeviceThatIsForWritingOnlyIsNotHeld) {
  start({{"writeonly", "1"}});
  plugged.unplug();
  run_until(loop, [&] { return log.events == "up lost "; });
}

TEST_F(UnpluggedPortTest, ADeviceThatDiesAsSoonAsItIsOpenIsOpenedEverLater) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to hang up a tty that stays there";
  start({{"alwaysopen", "1"}});
  const Instant begin = loop.now();
  std::string expected = "up ";
  for (int n = 0; n < 3; ++n) {
    const UniqueFd tty(::open(link.c_str(), O_RDWR | O_NOCTTY));
    ASSERT_EQ(::ioctl(tty.get(), TIOCVHANGUP), 0);
    expected += "interrupted resumed ";
    run_until(loop, [&] { return log.events == expected; });
  }
  EXPECT_EQ(log.events, expected);
  EXPECT_GE(loop.now() - begin, std::chrono::milliseconds(100 + 200 + 400));
}

}  // namespace
}  // namespace porttape
