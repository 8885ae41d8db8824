// A serial device's settings as the kernel is asked for them, and devices that refuse or take other ones. A
// pty shows no parity and refuses nothing (tty_test.cpp), so the tty here is played.

#include <algorithm>
#include <asm/termbits.h>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <sys/ioctl.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tty/tty.hpp"
#include "tests/tty/played_ioctl.hpp"

namespace porttape {
namespace {

constexpr int kTty = PlayedTty::kFd;
constexpr Nanos kHour = std::chrono::hours(1);

int refuse(int error_number) {
  errno = error_number;
  return -1;
}

class PlayedTtyTest : public testing::Test {
 protected:
  int play(unsigned long request, void* argument) {
    requests.push_back(request);
    if (request == refused && refused_after-- <= 0) return refuse(EIO);
    if (request == TCGETS2) {
      *static_cast<termios2*>(argument) = kept;
    } else if (request == TCSETS2) {
      kept = *static_cast<const termios2*>(argument);
      takes(kept);
    } else if (request == TIOCOUTQ) {
      *static_cast<int*>(argument) = queue.empty() ? 0 : queue.front();
      if (!queue.empty()) queue.erase(queue.begin());
    } else if (request == TIOCMBIS || request == TIOCMBIC) {
      lines = *static_cast<const int*>(argument);
    } else if (request == TCSBRK) {
      drain_argument = static_cast<int>(reinterpret_cast<std::intptr_t>(argument));
    }
    return 0;
  }
  [[nodiscard]] long times(unsigned long request) const {
    return std::count(requests.begin(), requests.end(), request);
  }
  static std::string error_of(const auto& result) {
    return result.has_value() ? "none" : result.error().message;
  }

  termios2 kept{};
  std::function<void(termios2&)> takes = [](termios2&) {};  // makes of it what the device takes
  std::vector<int> queue;                                   // what is unsent, look by look
  unsigned long refused = 0;
  int refused_after = 0;
  std::vector<unsigned long> requests;
  int lines = 0;
  int drain_argument = -1;
  const PlayedTty tty{[this](unsigned long request, void* argument) { return play(request, argument); }};
};

TEST_F(PlayedTtyTest, ParityAndDataBitsHaveTheirFlags) {
  struct Case {
    LineSettings settings;
    tcflag_t flags;
  };
  const tcflag_t mask = CSIZE | PARENB | PARODD | CMSPAR;
  for (const Case& each : {Case{{.data_bits = 8, .parity = Parity::none}, CS8},
                           Case{{.data_bits = 7, .parity = Parity::even}, CS7 | PARENB},
                           Case{{.data_bits = 6, .parity = Parity::odd}, CS6 | PARENB | PARODD},
                           Case{{.data_bits = 5, .parity = Parity::mark}, CS5 | PARENB | PARODD | CMSPAR},
                           Case{{.data_bits = 8, .parity = Parity::space}, CS8 | PARENB | CMSPAR}}) {
    kept.c_cflag ^= (kept.c_cflag ^ ~each.flags) & mask;  // from the opposite of each
    const Result<TakenSettings> taken = apply_settings(kTty, each.settings);
    ASSERT_TRUE(taken.has_value());
    EXPECT_EQ(kept.c_cflag & mask, each.flags);
    EXPECT_EQ(taken->not_taken, "");
    EXPECT_EQ(taken->settings, each.settings);
  }
}

TEST_F(PlayedTtyTest, WhatTheDeviceTakesOtherwiseIsNamed) {
  const LineSettings all{
      .data_bits = 7, .parity = Parity::odd, .stop_bits = 2, .hw_flow = true, .sw_flow = true};
  takes = [](termios2& tio) {
    tio.c_cflag = (tio.c_cflag & ~static_cast<tcflag_t>(CSIZE | PARENB | PARODD | CSTOPB | CRTSCTS)) | CS8;
    tio.c_iflag &= ~static_cast<tcflag_t>(IXON | IXOFF);
  };
  Result<TakenSettings> taken = apply_settings(kTty, all);
  ASSERT_TRUE(taken.has_value());
  EXPECT_EQ(taken->not_taken, "parity, data bits, stop bits, hwflowctrl, swflowctrl");
  EXPECT_EQ(taken->settings, (LineSettings{.data_bits = 7, .parity = Parity::odd}))
      << "the rest as read back";
  taken = apply_settings(kTty, {.hw_flow = true});
  ASSERT_TRUE(taken.has_value());
  EXPECT_EQ(taken->not_taken, "hwflowctrl");
  takes = [](termios2& tio) { tio.c_cflag |= CSTOPB; };
  taken = apply_settings(kTty, {});
  ASSERT_TRUE(taken.has_value());
  EXPECT_EQ(taken->not_taken, "stop bits");
  EXPECT_EQ(taken->settings.stop_bits, 2U);
}

TEST_F(PlayedTtyTest, ARateMayBeThreePercentOff) {
  unsigned rate = 0;
  takes = [&rate](termios2& tio) { tio.c_ospeed = rate; };
  for (const unsigned close : {9700U, 10000U, 10300U}) {
    rate = close;
    EXPECT_EQ(error_of(apply_settings(kTty, {.baud = 10000})), "none") << close;
  }
  for (const unsigned far : {9699U, 10301U, 0U, 4'000'000'000U}) {
    rate = far;
    const Result<TakenSettings> taken = apply_settings(kTty, {.baud = 10000});
    ASSERT_FALSE(taken.has_value()) << far;
    EXPECT_EQ(taken.error().code, Errc::device_missing);
  }
}

TEST_F(PlayedTtyTest, WhatTheDeviceRefusesIsNamed) {
  refused = TCSETS2;
  EXPECT_EQ(error_of(apply_settings(kTty, {})), "setting the line: Input/output error");
  EXPECT_EQ(error_of(make_pty_raw(kTty)), "making the pty raw: Input/output error");
  EXPECT_EQ(error_of(show_settings(kTty, {})), "setting the pty: Input/output error");
  const Result<TtyState> state = tty_state(kTty);
  ASSERT_TRUE(state.has_value());
  EXPECT_EQ(error_of(make_pty_fresh(kTty, *state, {})), "making the pty raw: Input/output error");
  refused = TCGETS2;
  refused_after = 1;
  EXPECT_EQ(error_of(apply_settings(kTty, {})), "reading the line settings back: Input/output error");
}

TEST_F(PlayedTtyTest, ALineThatCannotBeReadIsNotSet) {
  refused = TCGETS2;
  set_ignbrk(kTty);
  EXPECT_EQ(times(TCSETS2), 0);
  lower_modem_lines(kTty);
  EXPECT_EQ(times(TIOCMBIC), 0);
}

TEST_F(PlayedTtyTest, IgnbrkIsSetOnceAndNothingElse) {
  kept.c_iflag = IUTF8;
  set_ignbrk(kTty);
  EXPECT_EQ(kept.c_iflag, static_cast<tcflag_t>(IUTF8 | IGNBRK));
  EXPECT_EQ(kept.c_lflag, 0U);
  EXPECT_EQ(times(TCSETS2), 1);
  set_ignbrk(kTty);
  EXPECT_EQ(times(TCSETS2), 1) << "it stands";
}

TEST_F(PlayedTtyTest, TheModemLinesGoDownWhereACloseWouldLowerThem) {
  lower_modem_lines(kTty);
  EXPECT_EQ(times(TIOCMBIC), 0);
  kept.c_cflag |= HUPCL;
  lower_modem_lines(kTty);
  EXPECT_EQ(times(TIOCMBIC), 1);
  EXPECT_EQ(lines, TIOCM_DTR | TIOCM_RTS);
}

TEST_F(PlayedTtyTest, AModemLineIsSetOrCleared) {
  EXPECT_TRUE(set_modem_line(kTty, TIOCM_DTR, true).has_value());
  EXPECT_EQ(requests, std::vector<unsigned long>{TIOCMBIS});
  EXPECT_EQ(lines, TIOCM_DTR);
  requests.clear();
  EXPECT_TRUE(set_modem_line(kTty, TIOCM_RTS, false).has_value());
  EXPECT_EQ(requests, std::vector<unsigned long>{TIOCMBIC});
  EXPECT_EQ(lines, TIOCM_RTS);
}

TEST_F(PlayedTtyTest, AWaitEndsWithTheLastByteAndThenWaitsForTheUart) {
  kept.c_ospeed = 9600;
  queue = {3, 3, 2, 1, 0, 9};  // the first is asked for alone, to see whether there is such a count
  const std::atomic<bool> hurry = true;
  EXPECT_TRUE(wait_until_sent(kTty, Nanos{0}, hurry)) << "a line that gets on has a second";
  EXPECT_EQ(queue, std::vector<int>{9});
  EXPECT_EQ(times(TCSBRK), 1);
  EXPECT_EQ(drain_argument, 1) << "0 would send a break";
}

TEST_F(PlayedTtyTest, AWaitThatTheDeviceKnowsNotHasNoSuccess) {
  kept.c_ospeed = 9600;
  const std::atomic<bool> hurry = false;
  for (const unsigned long each : {static_cast<unsigned long>(TCGETS2), static_cast<unsigned long>(TIOCOUTQ),
                                   static_cast<unsigned long>(TCSBRK)}) {
    requests.clear();
    refused = each;
    EXPECT_FALSE(wait_until_sent(kTty, kHour, hurry)) << each;
    EXPECT_EQ(requests.back(), each) << "nothing is asked for behind it";
  }
}

TEST_F(PlayedTtyTest, AStoppedLineWithoutARateIsNotWaitedFor) {
  queue = {5, 5, 5};
  const std::atomic<bool> hurry = false;
  EXPECT_FALSE(wait_until_sent(kTty, kHour, hurry));
  EXPECT_EQ(requests, std::vector<unsigned long>{TCGETS2});
}

}  // namespace
}  // namespace porttape
