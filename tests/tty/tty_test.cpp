// The settings of a tty, as the kernel keeps them of a pty's slave. A pty is always of 8 data bits without
// parity (pty_set_termios in the kernel's drivers/tty/pty.c), and keeps all other flags.

#include "libport/tty/tty.hpp"

#include <asm/termbits.h>
#include <atomic>
#include <chrono>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/sysmacros.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

class TtyTest : public testing::Test {
 protected:
  TtyTest() {
    EXPECT_EQ(::ioctl(master.get(), TIOCSPTLCK, &unlocked), 0);
    slave.reset(::ioctl(master.get(), TIOCGPTPEER, O_RDWR | O_NOCTTY | O_CLOEXEC));
    EXPECT_TRUE(slave);
  }
  [[nodiscard]] termios2 flags() const {
    termios2 tio{};
    EXPECT_EQ(::ioctl(slave.get(), TCGETS2, &tio), 0);
    return tio;
  }
  void set(const termios2& tio) const { ASSERT_EQ(::ioctl(slave.get(), TCSETS2, &tio), 0); }
  TakenSettings apply(const LineSettings& settings) const {
    const Result<TakenSettings> taken = apply_settings(slave.get(), settings);
    EXPECT_TRUE(taken) << taken.error().message;
    return taken ? *taken : TakenSettings{};
  }

  const int unlocked = 0;
  UniqueFd master{::open("/dev/ptmx", O_RDWR | O_NOCTTY | O_CLOEXEC)};
  UniqueFd slave;
};

constexpr tcflag_t kRawInput = IGNBRK | BRKINT | PARMRK | ISTRIP | INLCR | IGNCR | ICRNL | IXANY | INPCK;
constexpr tcflag_t kRawLocal = ECHO | ECHOE | ECHOK | ICANON | ISIG | IEXTEN;

TEST_F(TtyTest, AppliedSettingsMakeTheLineRaw) {
  termios2 tio = flags();
  tio.c_iflag |= kRawInput;
  tio.c_oflag |= OPOST | ONLCR;
  tio.c_lflag |= kRawLocal | ECHONL | TOSTOP;
  tio.c_cflag |= HUPCL;
  tio.c_cflag &= ~static_cast<tcflag_t>(CREAD | CLOCAL);
  tio.c_cc[VMIN] = 7;
  tio.c_cc[VTIME] = 9;
  set(tio);
  EXPECT_EQ(apply({}).not_taken, "");
  tio = flags();
  EXPECT_EQ(tio.c_iflag & kRawInput, 0U);
  EXPECT_EQ(tio.c_oflag & OPOST, 0U);
  EXPECT_EQ(tio.c_lflag & (kRawLocal | ECHONL), 0U);
  EXPECT_EQ(tio.c_cc[VMIN], 1);
  EXPECT_EQ(tio.c_cc[VTIME], 0);
  EXPECT_EQ(tio.c_cflag & (CREAD | CLOCAL), static_cast<tcflag_t>(CREAD | CLOCAL));
  EXPECT_NE(tio.c_oflag & ONLCR, 0U) << "what does nothing is left";
  EXPECT_NE(tio.c_lflag & TOSTOP, 0U);
  EXPECT_NE(tio.c_cflag & HUPCL, 0U);
}

TEST_F(TtyTest, EachSettingHasItsFlags) {
  struct Case {
    LineSettings settings;
    tcflag_t control;
    tcflag_t input;
    const char* not_taken;
  };
  for (const Case& each : {
           Case{{}, 0, 0, ""},
           Case{{.stop_bits = 2}, CSTOPB, 0, ""},
           Case{{.hw_flow = true}, CRTSCTS, 0, ""},
           Case{{.sw_flow = true}, 0, IXON | IXOFF, ""},
           Case{{.data_bits = 7}, 0, 0, "data bits"},
           Case{{.data_bits = 5}, 0, 0, "data bits"},
           Case{{.parity = Parity::even}, 0, 0, "parity"},
           Case{{.parity = Parity::odd}, PARODD, 0, "parity"},
           Case{{.parity = Parity::mark}, PARODD | CMSPAR, 0, "parity"},
           Case{{.parity = Parity::space}, CMSPAR, 0, "parity"},
           Case{{.data_bits = 6, .parity = Parity::odd}, PARODD, 0, "parity, data bits"},
       }) {
    // From the opposite of each.
    termios2 tio = flags();
    tio.c_cflag ^= (tio.c_cflag ^ ~each.control) & (CSTOPB | CRTSCTS | PARODD | CMSPAR);
    tio.c_iflag ^= (tio.c_iflag ^ ~each.input) & (IXON | IXOFF);
    set(tio);
    const TakenSettings taken = apply(each.settings);
    EXPECT_EQ(taken.settings, each.settings);
    EXPECT_EQ(taken.not_taken, each.not_taken);
    EXPECT_EQ(flags().c_cflag & (CSTOPB | CRTSCTS | PARODD | CMSPAR), each.control) << each.not_taken;
    EXPECT_EQ(flags().c_iflag & (IXON | IXOFF), each.input);
  }
}

TEST_F(TtyTest, AStandardRateHasItsOwnCodeAndAnyOtherNone) {
  for (const auto& [baud, code] :
       {std::pair(50U, B50), std::pair(9600U, B9600), std::pair(115200U, B115200),
        std::pair(4000000U, B4000000), std::pair(100000U, BOTHER), std::pair(9601U, BOTHER)}) {
    termios2 tio = flags();
    tio.c_cflag |= B38400 << IBSHIFT;
    set(tio);
    EXPECT_EQ(apply({.baud = baud}).settings.baud, baud);
    EXPECT_EQ(flags().c_cflag & CBAUD, static_cast<tcflag_t>(code)) << baud;
    EXPECT_EQ(flags().c_ospeed, baud);
    EXPECT_EQ(flags().c_ispeed, baud);
  }
}

// The program's ioctl() makes a pty a device that does no such rate, see serial_rate_test.cpp.
TEST_F(TtyTest, ARateThatTheDeviceDoesNotTakeIsAnError) {
  (void)apply({.baud = 9600});
  const Result<TakenSettings> taken = apply_settings(slave.get(), {.baud = 200'000'000});
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, Errc::device_missing);
  EXPECT_EQ(taken.error().message,
            "the device does not do 200000000 baud (it took 9600): choose a rate it can do");
}

TEST_F(TtyTest, OfWhatIsNoTtyThereAreNoSettings) {
  int ends[2];
  ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
  const UniqueFd in(ends[0]);
  const UniqueFd out(ends[1]);
  const std::string why = ": Inappropriate ioctl for device";
  EXPECT_EQ(apply_settings(in.get(), {}).error().message, "reading the line settings" + why);
  EXPECT_EQ(shown_settings(in.get()).error().message, "reading the line settings" + why);
  EXPECT_EQ(tty_state(in.get()).error().message, "reading the pty's settings" + why);
  EXPECT_EQ(make_pty_raw(in.get()).error().message, "reading the pty's settings" + why);
  EXPECT_EQ(make_pty_fresh(in.get(), {}, {}).error().message, "reading the pty's settings" + why);
  EXPECT_EQ(show_settings(in.get(), {}).error().message, "reading the pty's settings" + why);
  EXPECT_EQ(set_modem_line(in.get(), TIOCM_DTR, true).error().message, "setting a modem line" + why);
  const std::atomic<bool> hurry = false;
  EXPECT_FALSE(wait_until_sent(in.get(), std::chrono::seconds(1), hurry));
}

TEST_F(TtyTest, WhatIsSentIsNotWaitedFor) {
  const std::atomic<bool> hurry = false;
  EXPECT_TRUE(wait_until_sent(slave.get(), std::chrono::hours(1), hurry));
}

TEST_F(TtyTest, ALineThatIsHungUpSendsNothing) {
  termios2 tio = flags();
  tio.c_cflag &= ~static_cast<tcflag_t>(CBAUD);  // B0
  tio.c_ospeed = 0;
  set(tio);
  const std::atomic<bool> hurry = false;
  EXPECT_FALSE(wait_until_sent(slave.get(), std::chrono::hours(1), hurry));
}

TEST_F(TtyTest, ARawPtyKeepsItsSpeedAndTellsDriversApart) {
  termios2 tio = flags();
  tio.c_iflag |= kRawInput | IXON | IXOFF;
  tio.c_lflag |= kRawLocal;
  tio.c_cflag = (tio.c_cflag & ~static_cast<tcflag_t>(CBAUD | CREAD)) | B19200 | CLOCAL | CSTOPB;
  set(tio);
  ASSERT_TRUE(make_pty_raw(slave.get()));
  tio = flags();
  EXPECT_EQ(tio.c_iflag & (kRawInput | IXON | IXOFF), static_cast<tcflag_t>(IGNBRK));
  EXPECT_EQ(tio.c_lflag & kRawLocal, 0U);
  EXPECT_EQ(tio.c_lflag & ECHONL, 0U);
  EXPECT_NE(tio.c_cflag & CREAD, 0U);
  EXPECT_EQ(tio.c_cflag & CLOCAL, 0U);
  EXPECT_NE(tio.c_cflag & CSTOPB, 0U);
  EXPECT_EQ(tio.c_ospeed, 19200U);
}

TEST_F(TtyTest, WhatAMasterShowsIsWhatTheSlaveHas) {
  (void)apply({.baud = 19200, .stop_bits = 2, .hw_flow = true, .sw_flow = true});
  Result<ShownSettings> shown = shown_settings(master.get());
  ASSERT_TRUE(shown);
  EXPECT_EQ(shown->settings, (SeenSettings{.baud = 19200, .stop_bits = 2, .hw_flow = true, .sw_flow = true}));
  EXPECT_TRUE(shown->clocal);
  EXPECT_TRUE(shown->ignbrk_cleared);
  set_ignbrk(master.get());
  clear_clocal(master.get());
  (void)show_settings(master.get(), {.baud = 4800});
  shown = shown_settings(master.get());
  ASSERT_TRUE(shown);
  EXPECT_EQ(shown->settings,
            (SeenSettings{.baud = 4800, .stop_bits = 1, .hw_flow = false, .sw_flow = false}));
  EXPECT_FALSE(shown->clocal);
  EXPECT_FALSE(shown->ignbrk_cleared);
}

TEST_F(TtyTest, OneDirectionOfSoftwareFlowControlIsTheDriversOwnAffair) {
  for (const tcflag_t one : {tcflag_t{IXON}, tcflag_t{IXOFF}}) {
    termios2 tio = flags();
    tio.c_iflag = (tio.c_iflag & ~static_cast<tcflag_t>(IXON | IXOFF)) | one;
    set(tio);
    EXPECT_FALSE(*shown_settings(master.get())->settings.sw_flow);
  }
}

TEST_F(TtyTest, AFreshPtyIsMadeOnlyWhereNobodyHasSetIt) {
  Result<TtyState> since = tty_state(master.get());
  ASSERT_TRUE(since);
  ASSERT_TRUE(make_pty_fresh(master.get(), *since, LineSettings{.baud = 4800, .stop_bits = 2}));
  EXPECT_EQ(flags().c_ospeed, 4800U);
  EXPECT_NE(flags().c_cflag & CSTOPB, 0U);
  EXPECT_EQ(flags().c_lflag & ICANON, 0U);
  ASSERT_TRUE(make_pty_fresh(master.get(), *since, LineSettings{.baud = 1200}));
  EXPECT_EQ(flags().c_ospeed, 4800U) << "it shows something else than then";
  since = tty_state(master.get());
  ASSERT_TRUE(make_pty_fresh(master.get(), *since, std::nullopt));
  EXPECT_EQ(flags().c_ospeed, 4800U) << "no settings are wanted";
}

TEST_F(TtyTest, ClocalIsNoSettingOfAProgram) {
  const Result<TtyState> since = tty_state(master.get());
  ASSERT_TRUE(since);
  termios2 tio = flags();
  tio.c_cflag ^= CLOCAL;
  set(tio);
  EXPECT_EQ(tty_state(master.get())->bytes, since->bytes);
  tio.c_cflag ^= CSTOPB;
  set(tio);
  EXPECT_NE(tty_state(master.get())->bytes, since->bytes);
}

TEST_F(TtyTest, APtyHasNoModemLines) {
  const Result<void> set = set_modem_line(slave.get(), TIOCM_RTS, false);
  ASSERT_FALSE(set);
  EXPECT_EQ(set.error().code, Errc::io);
  lower_modem_lines(slave.get());
  EXPECT_EQ(flags().c_cflag & CSIZE, static_cast<tcflag_t>(CS8)) << "nothing else is touched";
}

TEST(TtyDevice, IsToldByItsNumber) {
  EXPECT_EQ(is_tty_device(gnu_dev_makedev(136, 0)), true);
  EXPECT_EQ(is_tty_device(gnu_dev_makedev(143, 255)), true);
  EXPECT_NE(is_tty_device(gnu_dev_makedev(1, 3)), true) << "/dev/null is none";
  EXPECT_NE(is_tty_device(gnu_dev_makedev(135, 0)), true);
  EXPECT_NE(is_tty_device(gnu_dev_makedev(144, 0)), true);
}

TEST(TtyDevice, OfADriverOfItsOwnIsKnownBySysfs) {
  unsigned major_number = 0;
  unsigned minor_number = 0;
  char colon = ' ';
  std::ifstream("/sys/class/tty/tty/dev") >> major_number >> colon >> minor_number;
  const std::string place = fmt::format("/sys/dev/char/{}:{}", major_number, minor_number);
  if (!std::filesystem::exists(place)) GTEST_SKIP() << "there is no sysfs here";
  EXPECT_EQ(is_tty_device(gnu_dev_makedev(major_number, minor_number)), true);
  EXPECT_EQ(is_tty_device(gnu_dev_makedev(1, 3)), false) << "/dev/null is none";
}

}  // namespace
}  // namespace porttape
