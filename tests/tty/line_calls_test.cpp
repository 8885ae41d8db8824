// What the kernel is asked for by the system's LineCalls, and what becomes of its answers.

#include "libport/tty/line_calls.hpp"

#include <cerrno>
#include <cstdint>
#include <linux/serial.h>
#include <memory>
#include <optional>
#include <string>
#include <sys/ioctl.h>

#include <gtest/gtest.h>

#include "tests/tty/played_ioctl.hpp"

namespace porttape {
namespace {

class SystemLineCallsTest : public testing::Test {
 protected:
  using Name = LineSignal::Name;
  using Kind = LineRequest::Kind;

  static constexpr int kTty = PlayedTty::kFd;

  static int refuse(int error_number) {
    errno = error_number;
    return -1;
  }

  const std::shared_ptr<LineCalls> calls = LineCalls::of_system();
};

TEST_F(SystemLineCallsTest, EachSignalHasItsRequest) {
  struct Case {
    LineSignal signal;
    unsigned long request;
    int line;
  };
  for (const Case& each :
       {Case{{Name::dtr, true}, TIOCMBIS, TIOCM_DTR}, Case{{Name::dtr, false}, TIOCMBIC, TIOCM_DTR},
        Case{{Name::rts, true}, TIOCMBIS, TIOCM_RTS}, Case{{Name::rts, false}, TIOCMBIC, TIOCM_RTS},
        Case{{Name::brk, true}, TIOCSBRK, 0}, Case{{Name::brk, false}, TIOCCBRK, 0}}) {
    unsigned long asked = 0;
    int line = 0;
    const PlayedTty tty([&](unsigned long request, void* argument) {
      asked = request;
      if (each.line != 0) line = *static_cast<int*>(argument);
      return 0;
    });
    EXPECT_EQ(calls->set(kTty, each.signal), 0);
    EXPECT_EQ(asked, each.request);
    EXPECT_EQ(line, each.line);
  }
}

TEST_F(SystemLineCallsTest, WhatTheDeviceDrivesCannotBeSet) {
  int asked = 0;
  const PlayedTty tty([&](unsigned long, void*) { return ++asked, 0; });
  for (const Name name : {Name::cts, Name::dsr, Name::cd, Name::ri})
    EXPECT_EQ(calls->set(kTty, {name, true}), EINVAL) << name_of(name);
  EXPECT_EQ(asked, 0);
}

TEST_F(SystemLineCallsTest, ASignalThatIsRefusedIsItsErrorNumber) {
  const PlayedTty tty([](unsigned long, void*) { return refuse(EIO); });
  EXPECT_EQ(calls->set(kTty, {Name::rts, true}), EIO);
  EXPECT_EQ(calls->set(kTty, {Name::brk, true}), EIO);
}

TEST_F(SystemLineCallsTest, TheSerialStructIsAskedForAndSet) {
  serial_struct kept{};
  kept.custom_divisor = 7;
  const PlayedTty tty([&](unsigned long request, void* argument) {
    if (request == TIOCGSERIAL) *static_cast<serial_struct*>(argument) = kept;
    if (request == TIOCSSERIAL) kept = *static_cast<const serial_struct*>(argument);
    return request == TIOCGSERIAL || request == TIOCSSERIAL ? 0 : refuse(ENOTTY);
  });
  LineAnswer answer;
  EXPECT_EQ(calls->ask(kTty, {.kind = Kind::get_serial}, answer), 0);
  EXPECT_EQ(answer.serial.custom_divisor, 7);
  LineRequest request{.kind = Kind::set_serial};
  request.serial.custom_divisor = 9;
  EXPECT_EQ(calls->ask(kTty, request, answer), 0);
  EXPECT_EQ(kept.custom_divisor, 9);
}

TEST_F(SystemLineCallsTest, TheRs485SettingsThatAreAnsweredAreThoseThatTheDeviceTook) {
  serial_rs485 kept{};
  kept.delay_rts_before_send = 3;
  const PlayedTty tty([&](unsigned long request, void* argument) {
    auto* const rs485 = static_cast<serial_rs485*>(argument);
    if (request == TIOCSRS485) {
      kept = *rs485;
      rs485->delay_rts_after_send = 100;  // the most that it can do
    }
    if (request == TIOCGRS485) *rs485 = kept;
    return request == TIOCGRS485 || request == TIOCSRS485 ? 0 : refuse(ENOTTY);
  });
  LineAnswer answer;
  EXPECT_EQ(calls->ask(kTty, {.kind = Kind::get_rs485}, answer), 0);
  EXPECT_EQ(answer.rs485.delay_rts_before_send, 3U);
  LineRequest request{.kind = Kind::set_rs485};
  request.rs485.delay_rts_before_send = 4;
  request.rs485.delay_rts_after_send = 500;
  EXPECT_EQ(calls->ask(kTty, request, answer), 0);
  EXPECT_EQ(kept.delay_rts_before_send, 4U);
  EXPECT_EQ(kept.delay_rts_after_send, 500U);
  EXPECT_EQ(answer.rs485.delay_rts_before_send, 4U);
  EXPECT_EQ(answer.rs485.delay_rts_after_send, 100U);
}

TEST_F(SystemLineCallsTest, ARequestThatIsRefusedIsItsErrorNumber) {
  const PlayedTty tty([](unsigned long, void*) { return refuse(ENOTTY); });
  LineAnswer answer;
  for (const Kind kind : {Kind::get_serial, Kind::set_serial, Kind::get_rs485, Kind::set_rs485})
    EXPECT_EQ(calls->ask(kTty, {.kind = kind}, answer), ENOTTY);
}

TEST_F(SystemLineCallsTest, TheLastBreakIsNoRequestToTheKernel) {
  int asked = 0;
  const PlayedTty tty([&](unsigned long, void*) { return ++asked, 0; });
  LineAnswer answer;
  EXPECT_EQ(calls->ask(kTty, {.kind = Kind::last_break}, answer), EINVAL);
  EXPECT_EQ(asked, 0);
}

TEST_F(SystemLineCallsTest, UnsentBytesAreTheKernelsCountAndNoneWhereItTellsNone) {
  int left = 0;
  int result = 0;
  const PlayedTty tty([&](unsigned long request, void* argument) {
    EXPECT_EQ(request, static_cast<unsigned long>(TIOCOUTQ));
    *static_cast<int*>(argument) = left;
    return result;
  });
  EXPECT_EQ(calls->unsent(kTty), 0U);
  left = 1;
  EXPECT_EQ(calls->unsent(kTty), 1U);
  left = 4095;
  EXPECT_EQ(calls->unsent(kTty), 4095U);
  left = -1;
  EXPECT_EQ(calls->unsent(kTty), 0U);
  left = 5;
  result = -1;
  EXPECT_EQ(calls->unsent(kTty), 0U);
}

TEST_F(SystemLineCallsTest, ModemLinesAreTheKernelsAndUnknownWhereThereAreNone) {
  int result = 0;
  const PlayedTty tty([&](unsigned long request, void* argument) {
    EXPECT_EQ(request, static_cast<unsigned long>(TIOCMGET));
    *static_cast<int*>(argument) = TIOCM_CTS | TIOCM_CD;
    return result;
  });
  EXPECT_EQ(calls->modem_lines(kTty), TIOCM_CTS | TIOCM_CD);
  result = -1;
  EXPECT_EQ(calls->modem_lines(kTty), std::nullopt);
}

TEST_F(SystemLineCallsTest, EachCounterIsThatOfItsSignal) {
  int result = 0;
  const PlayedTty tty([&](unsigned long request, void* argument) {
    EXPECT_EQ(request, static_cast<unsigned long>(TIOCGICOUNT));
    auto& counts = *static_cast<serial_icounter_struct*>(argument);
    counts.cts = 1;
    counts.dsr = 2;
    counts.rng = 3;
    counts.dcd = 4;
    counts.brk = 5;
    return result;
  });
  const std::optional<SignalCounts> counts = calls->counts(kTty);
  ASSERT_TRUE(counts);
  EXPECT_EQ(counts->cts, 1);
  EXPECT_EQ(counts->dsr, 2);
  EXPECT_EQ(counts->ri, 3);
  EXPECT_EQ(counts->cd, 4);
  EXPECT_EQ(counts->breaks, 5);
  result = -1;
  EXPECT_FALSE(calls->counts(kTty));
}

TEST_F(SystemLineCallsTest, AWaitIsForEachLineThatTheDeviceDrives) {
  int error = 0;
  const PlayedTty tty([&](unsigned long request, void* argument) {
    EXPECT_EQ(request, static_cast<unsigned long>(TIOCMIWAIT));
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(argument),
              static_cast<std::uintptr_t>(TIOCM_CTS | TIOCM_DSR | TIOCM_CD | TIOCM_RNG));
    return error == 0 ? 0 : refuse(error);
  });
  EXPECT_EQ(calls->wait_for_change(kTty), 0);
  error = EINTR;
  EXPECT_EQ(calls->wait_for_change(kTty), EINTR);
}

}  // namespace
}  // namespace porttape
