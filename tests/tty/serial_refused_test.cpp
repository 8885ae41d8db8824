// What a SerialPort does where a call of the system fails.

#include <asm/termbits.h>  // TCGETS2; not to be mixed with <termios.h>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <map>
#include <optional>
#include <poll.h>
#include <string>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/tty/serial_rig.hpp"

namespace porttape {
namespace {

using test::refused_ioctl;
using test::refused_on;
using test::refused_open;
using test::RefusedCall;
using test::while_refused;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class SerialRefused : public SerialPortTest {
 protected:
  void start(std::map<std::string, std::string> options = {}) {
    log.events.clear();
    make_port(std::move(options));
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
    ASSERT_EQ(log.events, "up ");
  }
  // The descriptor that the port has of its device.
  [[nodiscard]] int own_fd() const {
    for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
      std::error_code gone;
      if (std::filesystem::read_symlink(entry.path(), gone) == path)
        return std::stoi(entry.path().filename());
    }
    ADD_FAILURE() << path << " is not open";
    return -1;
  }
  void poll_loop() {
    for (int n = 0; n < 20; ++n) loop.poll_one();
  }
  void expect_line() {
    ASSERT_EQ(::write(device.get(), "ask", 3), 3);
    log.data.clear();
    run_until(loop, [&] { return log.data == "ask"; });
    port->write(as_bytes("answer"));
    const Reader reader(loop, device.get());
    run_until(loop, [&] { return reader.got == "answer"; });
  }
  [[nodiscard]] std::size_t times_told(std::string_view text) const {
    const std::string all = book.text();
    std::size_t count = 0;
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }
};

TEST_F(SerialRefused, ADeviceThatCannotBeLookedAtIsMissingAndTheReasonIsTold) {
  const std::pair<RefusedCall, std::string> cases[] = {
      {{SYS_newfstatat, EACCES}, "Permission denied; ls -l tells who may open it"},
      {{SYS_newfstatat, ELOOP}, "Too many levels of symbolic links; check the device"},
      {{SYS_newfstatat, ENOENT}, "No such file or directory; is it plugged in? (--wait-device waits for it)"},
#ifdef SYS_access
      {{SYS_access, EROFS}, "Read-only file system; check the device"},
      {{SYS_access, ENOENT}, "No such file or directory; is it plugged in? (--wait-device waits for it)"},
#endif
  };
  for (const auto& [refused, why] : cases) {
    EXPECT_TRUE(while_refused({refused}, [&, why = why] {
      EXPECT_EQ(prepare_error(path), make_error(Errc::device_missing, "device '" + path + "': " + why));
    }));
  }
#ifdef SYS_access
  EXPECT_TRUE(while_refused({{SYS_access, EACCES}}, [&] {
    const Error error = prepare_error(path);
    EXPECT_THAT(error.message, HasSubstr("device '" + path + "': Permission denied; "));
    EXPECT_THAT(error.message, Not(HasSubstr("ls -l tells"))) << "it is said who may";
  }));
#endif
}

TEST_F(SerialRefused, AnOpenThatFailsIsToldWithWhatToDo) {
  const int flags = O_NOCTTY | O_NONBLOCK;
  const std::pair<std::vector<RefusedCall>, std::string> cases[] = {
      {{refused_open(flags, ENXIO)}, ": No such device or address; check the device"},
      {{refused_open(flags, EIO)}, ": Input/output error; check the device"},
      {{refused_open(flags, EBUSY)}, ": Device or resource busy; another program has it open"},
      {{refused_open(flags, EACCES)}, ": Permission denied; ls -l tells who may open it"},
      {{refused_open(flags, EMFILE)}, ": Too many open files; check the device"},
      {{refused_ioctl(TCGETS, EIO), refused_ioctl(TCGETS2, EIO)}, " is not a serial device"},
      {{{SYS_flock, EWOULDBLOCK}}, " is busy; another program has it open"},
      {{refused_ioctl(TCSETS2, EIO)}, ": setting the line: Input/output error"}};
  for (const auto& [refused, why] : cases) {
    log.events.clear();
    make_port();
    ASSERT_TRUE(port->prepare().has_value());
    EXPECT_TRUE(while_refused(refused, [&] { port->open(); }));
    EXPECT_EQ(log.events, "failed ") << why;
    EXPECT_EQ(log.error.code,
              why.find("setting") == std::string::npos ? Errc::device_missing : log.error.code);
    EXPECT_THAT(log.error.message, testing::StartsWith("device '" + path + "'" + why));
    EXPECT_EQ(port->unread_by_peer(), 0U) << "there is no line";
    port->close();
    settle(loop);
    log.events.clear();
    port->open();
    EXPECT_EQ(log.events, "up ") << "nothing keeps the device busy after " << why;
    port->close();
    settle(loop);
  }
}

TEST_F(SerialRefused, ALockOfADeviceThatCouldNotBeSetGoesWithTheDescriptor) {
  make_port({{"uucplock", "1"}});
  ASSERT_TRUE(port->prepare().has_value());
  EXPECT_TRUE(while_refused({refused_ioctl(TCSETS2, EIO)}, [&] { port->open(); }));
  EXPECT_EQ(log.events, "failed ");
  EXPECT_FALSE(std::filesystem::exists(lock_of(path)));
}

// While another program has the device open, it would stay so.
TEST_F(SerialRefused, ExclusiveUseEndsWithAnOpenThatFailsAndWithThePort) {
  const UniqueFd other(::open(path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  const auto is_exclusive = [&other] {
    int on = 0;
    EXPECT_EQ(::ioctl(other.get(), TIOCGEXCL, &on), 0);
    return on != 0;
  };
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  EXPECT_TRUE(while_refused({refused_ioctl(TCSETS2, EIO)}, [&] { port->open(); }));
  EXPECT_EQ(log.events, "failed ");
  EXPECT_FALSE(is_exclusive());
  start();
  EXPECT_TRUE(is_exclusive());
  port->close();
  EXPECT_FALSE(is_exclusive());
  settle(loop);
  start();
  EXPECT_TRUE(is_exclusive());
  port.reset();
  EXPECT_FALSE(is_exclusive());
  settle(loop);
}

TEST_F(SerialRefused, WhatADeviceNeedNotHaveCostsNoLine) {
  const RefusedCall failing[] = {{SYS_flock, ENOLCK},         {SYS_flock, EINVAL},
                                 {SYS_flock, EINTR},          refused_ioctl(TIOCEXCL, EIO),
                                 refused_ioctl(TCFLSH, EIO),  refused_ioctl(TIOCMGET, ENOTTY),
                                 refused_ioctl(TIOCNXCL, EIO)};
  for (const RefusedCall& refused : failing) {
    EXPECT_TRUE(while_refused({refused}, [&] {
      start();
      expect_line();
      port->close();
      settle(loop);
    }));
  }
}

TEST_F(SerialRefused, AModemLineThatCannotBeSetIsToldOnceWithItsOption) {
  EXPECT_TRUE(while_refused({refused_ioctl(TIOCMBIS, EIO), refused_ioctl(TIOCMBIC, EPERM)}, [&] {
    start({{"dtr", "on"}, {"rts", "off"}});
    port->close();
    settle(loop);
    port->open();
    run_until(loop, [&] { return log.events == "up up "; });
  }));
  EXPECT_EQ(times_told("option 'dtr': setting a modem line: Input/output error"), 1U) << book.text();
  EXPECT_EQ(times_told("option 'rts': setting a modem line: Operation not permitted"), 1U) << book.text();
}

TEST_F(SerialRefused, AReadThatIsInterruptedOrFindsNothingLosesNoDevice) {
  start();
  for (const int error : {EINTR, EAGAIN}) {
    log.data.clear();
    ASSERT_EQ(::write(device.get(), "ask", 3), 3);
    EXPECT_TRUE(while_refused({refused_on(own_fd(), SYS_read, error)}, [&] {
      poll_loop();
      port->read_pending();
    }));
    EXPECT_EQ(log.events, "up ");
    EXPECT_EQ(log.data, "");
    run_until(loop, [&] { return log.data == "ask"; });
  }
}

TEST_F(SerialRefused, AReadThatFailsIsALostDeviceWithTheReason) {
  const std::pair<int, std::string> cases[] = {
      {EIO, "Input/output error"}, {ENXIO, "No such device or address"}, {0, "Input/output error"}};
  for (const auto& [error, why] : cases) {
    start();
    ASSERT_EQ(::write(device.get(), "ask", 3), 3);
    EXPECT_TRUE(while_refused({refused_on(own_fd(), SYS_read, error)},
                              [&] { run_until(loop, [&] { return log.events == "up lost "; }); }));
    EXPECT_EQ(log.error,
              make_error(Errc::device_lost, "device '" + path + "' is lost (" + why + "); plug it in again"));
    port->close();
    settle(loop);
  }
}

TEST_F(SerialRefused, WhatCannotBeReadAtTheEndIsLeft) {
  start();
  ASSERT_EQ(::write(device.get(), "four", 4), 4);
  for (const int error : {EIO, EAGAIN, 0}) {
    EXPECT_TRUE(while_refused({refused_on(own_fd(), SYS_read, error)}, [&] { port->read_pending(); }));
    EXPECT_EQ(log.data, "");
    EXPECT_EQ(log.events, "up ");
  }
  while (log.data.size() < 4) port->read_pending();
}

TEST_F(SerialRefused, WhereItCannotBeSeenHowMuchThereIsAllIsRead) {
  start();
  EXPECT_TRUE(while_refused({refused_ioctl(FIONREAD, EIO)}, [&] {
    ASSERT_EQ(::write(device.get(), "last", 4), 4);
    while (log.data.size() < 4) port->read_pending();
  }));
  EXPECT_EQ(log.data, "last");
}

// The one that takes the bytes may want no more of them, or no line.
TEST_F(SerialRefused, ReadingAtTheEndStopsWhereTheListenerWantsNoMore) {
  for (const bool hangs_up : {false, true}) {
    start();
    log.data.clear();
    const int fd = own_fd();
    log.on_bytes = [&] {
      if (log.data.size() > 1) return;
      if (hangs_up) {
        port->hang_up(false);
      } else {
        port->set_reading(false);
        ASSERT_EQ(::write(device.get(), "b", 1), 1);
        pollfd more{fd, POLLIN, 0};
        EXPECT_EQ(::poll(&more, 1, 60'000), 1);
      }
    };
    ASSERT_EQ(::write(device.get(), "a", 1), 1);
    EXPECT_TRUE(while_refused({refused_ioctl(FIONREAD, EIO)}, [&] {
      while (log.data.empty()) port->read_pending();
    }));
    EXPECT_EQ(log.data, "a");
    log.on_bytes = {};
    settle(loop);
    port->close();
    settle(loop);
  }
}

// Else a device that goes on sending would keep a session from its end.
TEST_F(SerialRefused, ReadingAtTheEndTakesWhatWasThereAndNoMore) {
  start();
  const int fd = own_fd();
  const auto arrives = [&](const char* bytes) {
    ASSERT_EQ(::write(device.get(), bytes, std::strlen(bytes)), static_cast<ssize_t>(std::strlen(bytes)));
    pollfd more{fd, POLLIN, 0};
    ASSERT_EQ(::poll(&more, 1, 60'000), 1);
  };
  arrives("first");
  log.on_bytes = [&] {
    if (log.data == "first") arrives("later");
  };
  port->read_pending();
  EXPECT_EQ(log.data, "first");
  log.on_bytes = {};
  run_until(loop, [&] { return log.data == "firstlater"; });
}

TEST_F(SerialRefused, WhatCannotBeCountedIsNotUnread) {
  start();
  EXPECT_TRUE(while_refused({refused_ioctl(TIOCOUTQ, EIO)}, [&] { EXPECT_EQ(port->unread_by_peer(), 0U); }));
}

TEST_F(SerialRefused, AWriteThatFailsIsToldAndTheDeviceIsLostOnTheNextTurn) {
  for (const auto& [error, why] :
       {std::pair(EIO, "Input/output error"), std::pair(ENXIO, "No such device or address")}) {
    start();
    log.dropped = 0;
    EXPECT_TRUE(
        while_refused({refused_on(own_fd(), SYS_write, error)}, [&] { port->write(as_bytes("four")); }));
    EXPECT_EQ(log.dropped, 4U);
    EXPECT_EQ(log.why, "they could not be sent");
    EXPECT_EQ(log.events, "up ") << "not under the writer's feet";
    run_until(loop, [&] { return log.events == "up lost "; });
    EXPECT_THAT(log.error.message, HasSubstr(why));
    port->close();
    settle(loop);
  }
}

TEST_F(SerialRefused, WhatTheKernelHasNoRoomForIsKeptAndSent) {
  start();
  for (const int error : {ENOMEM, ENOBUFS, EAGAIN}) {
    EXPECT_TRUE(while_refused({refused_on(own_fd(), SYS_write, error)}, [&] {
      port->write(as_bytes("four"));
      EXPECT_TRUE(port->congested());
      poll_loop();
    }));
    const Reader reader(loop, device.get());
    run_until(loop, [&] { return reader.got == "four"; });
    EXPECT_EQ(log.dropped, 0U);
    EXPECT_THAT(log.events, Not(HasSubstr("lost")));
  }
}

// What one port leaves to the loop is not done to another that has its place in memory by then.
TEST_F(SerialRefused, AFailedWriteOfAPortThatIsGoneLosesNoOthersDevice) {
  make_port();
  std::optional<SerialPort> own;
  const auto make_own = [&] {
    const Result<PortOptions> checked = check_options(PortOptions{&type, {{"device", path}}});
    const Result<PortSpec> spec = PortSpec::read(*checked);
    SerialOptions options = *spec->get<SerialOptions>();
    options.lock_folder = locks.path().string();
    own.emplace(PortContext{&loop, book.log()}, spec->common(), options, calls);
    own->listen(log);
    ASSERT_TRUE(own->prepare().has_value());
    own->open();
  };
  make_own();
  EXPECT_TRUE(while_refused({refused_on(own_fd(), SYS_write, EIO)}, [&] { own->write(as_bytes("x")); }));
  own.reset();
  while (loop.has_jobs()) std::this_thread::yield();  // it is closed, and the loop has not been told
  log.events.clear();
  make_own();
  ASSERT_EQ(log.events, "up ");
  settle(loop);
  EXPECT_EQ(log.events, "up ");
}

TEST_F(SerialRefused, WhatTheDeviceDoesNotTakeOfADriversSettingsIsToldOnce) {
  start();
  const LineSettings before = *port->settings();
  EXPECT_TRUE(while_refused({refused_ioctl(TCSETS2, EIO)}, [&] {
    for (const unsigned baud : {4800U, 2400U}) {
      (void)port->apply({.baud = baud});
      run_until(loop, [&] { return port->settings()->baud == before.baud; });
    }
  }));
  EXPECT_EQ(times_told("the device keeps its settings (told once)"), 1U) << book.text();
}

}  // namespace
}  // namespace porttape
