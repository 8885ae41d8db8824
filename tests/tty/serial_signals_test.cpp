#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <functional>
#include <map>
#include <memory>
#include <pthread.h>
#include <string>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tty/tty.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/tty/played_line.hpp"
#include "tests/tty/serial_rig.hpp"

namespace porttape {
namespace {

using Name = LineSignal::Name;

// A port whose device is a pty for bytes and settings, and played for the rest.
class SerialSignalsTest : public SerialPortTest {
 protected:
  SerialSignalsTest() { line->device = device.get(); }
  void make(std::map<std::string, std::string> options = {{"baud", "4800"}}, bool watched = false) {
    calls = line;
    make_port(std::move(options));
    port->tell(line::WatchSignals{watched});
    ASSERT_TRUE(port->prepare().has_value());
  }
  void start(std::map<std::string, std::string> options = {{"baud", "4800"}}) {
    make(std::move(options));
    port->open();
    ASSERT_EQ(log.events, "up ");
  }
  void until_journal(const std::string& wanted) {
    run_until(loop, [&] { return line->journal().size() >= wanted.size(); });
    EXPECT_EQ(line->journal(), wanted);
  }
  void until_events(const std::string& wanted) {
    run_until(loop, [&] { return log.events.size() >= wanted.size(); });
    EXPECT_EQ(log.events, wanted);
  }
  void drain(int& done) {
    log.drain(*port, [&done] { ++done; });
  }
  // The device's answer: `- ` for none, else the error and what it has.
  void ask(LineRequest request, std::string& told) {
    log.ask(*port, request, [&told](const std::optional<LineAnswer>& answer) {
      told += answer ? fmt::format("{},{},{} ", answer->error, answer->serial.custom_divisor,
                                   answer->rs485.delay_rts_after_send)
                     : "- ";
    });
  }
  void until_told(const std::string& told, const std::string& wanted) {
    run_until(loop, [&] { return told.size() >= wanted.size(); });
    EXPECT_EQ(told, wanted);
  }
  static LineRequest made_rs485(unsigned delay) {
    LineRequest request{.kind = LineRequest::Kind::set_rs485};
    request.rs485.delay_rts_after_send = delay;
    return request;
  }
  void until_done(const int& done) {
    run_until(loop, [&] { return done > 0; });
    while (loop.poll_one()) {
    }
    EXPECT_EQ(done, 1);
  }
  [[nodiscard]] std::size_t times_told(std::string_view text) const {
    const std::string all = book.text();
    std::size_t count = 0;
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }

  std::shared_ptr<PlayedLine> line = std::make_shared<PlayedLine>();
};

TEST_F(SerialSignalsTest, AreDrivenInTurnWithTheBytes) {
  start();
  port->write(as_bytes("a"));
  port->tell(LineSignal{Name::rts, true});
  port->write(as_bytes("b"));
  port->tell(LineSignal{Name::rts, false});
  port->tell(LineSignal{Name::dtr, false});
  port->write(as_bytes("c"));
  until_journal("a[rts+]b[rts-][dtr-]c");
  run_until(loop, [&] { return !port->congested(); });
  EXPECT_EQ(log.events, "up drained ");
}

TEST_F(SerialSignalsTest, ABreakBeginsOnceTheBytesAreSent) {
  start();
  port->write(as_bytes("a"));
  port->tell(LineSignal{Name::brk, true});
  port->tell(LineSignal{Name::brk, false});
  port->write(as_bytes("b"));
  until_journal("a(sent)[break+][break-]b");
}

TEST_F(SerialSignalsTest, OneThatCouldNotBeMadeIsToldOnceWithTheReasonAndOneThatWasMadeIsNot) {
  struct Case {
    int error;
    std::string rts;
    std::string brk;
  };
  const std::string ignored = "; what the driver does to them is ignored";
  const Case cases[] = {
      {0, "", ""},
      {ENOTTY, "the device has no modem lines" + ignored, "the device has no breaks" + ignored},
      {EINVAL, "the device has no modem lines" + ignored, "the device has no breaks" + ignored},
      {EOPNOTSUPP, "the device has no modem lines" + ignored, "the device has no breaks" + ignored},
      {ETIMEDOUT, "", "a break is left out, since the device does not take the bytes before it"},
      {EPERM, "setting rts: Operation not permitted; check the device",
       "setting break: Operation not permitted; check the device"},
      {EIO, "setting rts: Input/output error; check the device",
       "setting break: Input/output error; check the device"}};
  for (const auto& [error, rts, brk] : cases) {
    for (const auto& [name, text] : {std::pair(Name::rts, rts), std::pair(Name::brk, brk)}) {
      if (error == ETIMEDOUT && name == Name::rts) continue;  // a break's alone
      const std::size_t begin = book.text().size();
      line->error = error;
      start();
      for (const bool on : {true, false, true, false}) port->tell(LineSignal{name, on});
      int done = 0;
      drain(done);
      until_done(done);
      const std::string told = book.text().substr(begin);
      EXPECT_EQ(std::ranges::count(told, '\n'), text.empty() ? 0 : 1) << error << ": " << told;
      EXPECT_NE(told.find(text), std::string::npos) << told;
      if (!text.empty()) {
        const bool has_none = error == ENOTTY || error == EINVAL;
        EXPECT_NE(told.find(has_none ? "[info]" : "[warning]"), std::string::npos) << told;
      }
      port->close();
      settle(loop);
      log.events.clear();
    }
  }
}

TEST_F(SerialSignalsTest, ChangesOfSettingsKeepTheirPlaceAmongThem) {
  start();
  port->tell(LineSignal{Name::rts, true});
  ASSERT_TRUE(port->apply({.baud = 1200}).has_value());
  port->write(as_bytes("a"));
  port->tell(LineSignal{Name::rts, false});
  ASSERT_TRUE(port->apply({.baud = 2400}).has_value());
  EXPECT_EQ(port->settings()->baud, 2400U);
  until_journal("[rts+](sent)a[rts-](sent)");
  run_until(loop, [&] { return shown_settings(device.get())->settings.baud == 2400U; });
}

TEST_F(SerialSignalsTest, WaitForBytesThatTheDeviceHasNotTaken) {
  start();
  const std::string block(4096, 'b');
  while (!port->congested()) port->write(as_bytes(block));
  port->tell(LineSignal{Name::rts, false});
  port->write(as_bytes("new"));
  std::string all;
  run_until(loop, [&] { return (all = line->journal()).ends_with("new"); });
  EXPECT_TRUE(all.ends_with("bb[rts-]new"));
}

TEST_F(SerialSignalsTest, ABreakBehindBytesThatStandStillIsLeftOutAndTold) {
  start();
  line->moves = false;
  for (int i = 0; i < 2; ++i) {
    port->tell(LineSignal{Name::brk, true});
    port->tell(LineSignal{Name::brk, false});
  }
  port->write(as_bytes("a"));
  until_journal("[break-][break-]a");
  EXPECT_EQ(times_told("a break is left out"), 1U);
}

TEST_F(SerialSignalsTest, WhatTheDeviceHasNotIsToldOnce) {
  start();
  line->error = ENOTTY;
  for (const Name name : {Name::dtr, Name::rts, Name::dtr}) port->tell(LineSignal{name, true});
  port->write(as_bytes("a"));
  until_journal("[dtr+][rts+][dtr+]a");
  EXPECT_EQ(times_told(path + ": the device has no modem lines; what the driver does to them is ignored"),
            1U);
  EXPECT_EQ(times_told("[warning]"), 0U);
}

// cdc_acm, of a USB device that knows none.
TEST_F(SerialSignalsTest, ADeviceWithoutBreaksIsAWarning) {
  start();
  line->error = EOPNOTSUPP;
  for (int i = 0; i < 2; ++i) {
    port->tell(LineSignal{Name::brk, true});
    port->tell(LineSignal{Name::brk, false});
  }
  port->write(as_bytes("a"));
  until_journal("(sent)[break+][break-](sent)[break+][break-]a");
  EXPECT_EQ(times_told("the device has no breaks"), 1U);
  EXPECT_EQ(times_told("check the device"), 0U);
  EXPECT_EQ(times_told("[warning]"), 1U);
}

TEST_F(SerialSignalsTest, OtherTroubleIsAWarning) {
  start();
  line->error = EIO;
  for (int i = 0; i < 2; ++i) port->tell(LineSignal{Name::rts, true});
  port->write(as_bytes("a"));
  until_journal("[rts+][rts+]a");
  EXPECT_EQ(times_told("[warning] serial:" + path + ": setting rts: Input/output error; check the device"),
            1U);
}

TEST_F(SerialSignalsTest, WhatIsAskedIsAnsweredByTheDeviceInTurnWithTheRest) {
  start();
  LineRequest wanted{.kind = LineRequest::Kind::set_serial};
  wanted.serial.custom_divisor = 7;
  std::string told;
  port->write(as_bytes("a"));
  ask(wanted, told);
  port->write(as_bytes("b"));
  ask(made_rs485(3), told);
  port->tell(LineSignal{Name::rts, true});
  ask({.kind = LineRequest::Kind::get_serial}, told);
  port->write(as_bytes("c"));
  until_told(told, "0,7,0 0,7,3 0,7,3 ");
  until_journal("a[set serial]b[set rs485][rts+][get serial]c");
}

TEST_F(SerialSignalsTest, WhatADeviceWithModemLinesRefusesIsItsAnswer) {
  start();
  line->ask_error = ENOTTY;
  std::string told;
  ask({.kind = LineRequest::Kind::get_rs485}, told);
  until_told(told, fmt::format("{},0,0 ", ENOTTY));
}

TEST_F(SerialSignalsTest, ATtyWithoutAnyOfItIsNoneToAsk) {
  start();
  line->lose_lines();
  line->ask_error = ENOTTY;
  std::string told;
  ask({.kind = LineRequest::Kind::get_rs485}, told);
  line->error = ENOTTY;
  port->tell(LineSignal{Name::brk, true});
  ask({.kind = LineRequest::Kind::last_break}, told);
  until_told(told, "- - ");
}

TEST_F(SerialSignalsTest, WhetherABreakWasTakenIsKnownBehindIt) {
  start();
  std::string told;
  port->tell(LineSignal{Name::brk, true});
  ask({.kind = LineRequest::Kind::last_break}, told);
  until_told(told, "0,0,0 ");
  line->error = EOPNOTSUPP;
  port->tell(LineSignal{Name::brk, false});
  port->tell(LineSignal{Name::brk, true});
  port->tell(LineSignal{Name::brk, false});
  ask({.kind = LineRequest::Kind::last_break}, told);
  until_told(told, fmt::format("0,0,0 {},0,0 ", EOPNOTSUPP));
}

TEST_F(SerialSignalsTest, AQuestionIsAnsweredOnceWhenTheLineIsClosed) {
  start();
  std::string told;
  ask({.kind = LineRequest::Kind::get_serial}, told);
  port->close();
  until_told(told, fmt::format("{},0,0 ", EIO));
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  EXPECT_EQ(told, fmt::format("{},0,0 ", EIO));
}

TEST_F(SerialSignalsTest, APtyHasNone) {
  make_port();
  ASSERT_TRUE(port->prepare().has_value());
  port->tell(line::WatchSignals{true});
  port->open();
  for (const Name name : {Name::dtr, Name::brk, Name::rts, Name::cts}) port->tell(LineSignal{name, true});
  port->write(as_bytes("a"));
  until_journal("a");
  int done = 0;
  drain(done);
  until_done(done);
  EXPECT_EQ(times_told("no modem lines"), 1U);
  EXPECT_EQ(log.events, "up drained ");
}

TEST_F(SerialSignalsTest, WithoutALineTheyAreIgnored) {
  make();
  port->tell(LineSignal{Name::rts, true});
  int done = 0;
  drain(done);
  EXPECT_EQ(done, 1);
  port->open();
  port->write(as_bytes("a"));
  until_journal("a");
}

// No duplicate for another thread: what is asked for is done at once, and waits for nothing.
TEST_F(SerialSignalsTest, WithoutADescriptorForTheJobItIsDoneAtOnce) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  start();
  std::string told;
  int done = 0;
  {
    const test::NoDescriptors none(unsanitized);
    port->tell(LineSignal{Name::rts, true});
    EXPECT_EQ(line->journal(), "[rts+]");
    port->tell(LineSignal{Name::brk, true});
    EXPECT_EQ(line->journal(), "[rts+][break+]");
    ask(made_rs485(3), told);
    EXPECT_EQ(told, "0,0,3 ");
    EXPECT_TRUE(port->apply({.baud = 1200}).has_value());
    EXPECT_EQ(shown_settings(device.get())->settings.baud, 1200U);
    drain(done);
    EXPECT_EQ(done, 1);
  }
  EXPECT_EQ(line->journal(), "[rts+][break+][set rs485]");
}

TEST_F(SerialSignalsTest, WithoutADescriptorABreakThatWouldHaveToWaitIsLeftOut) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  start();
  line->queued = 1;
  std::string told;
  {
    const test::NoDescriptors none(unsanitized);
    port->tell(LineSignal{Name::brk, true});
    port->tell(LineSignal{Name::brk, false});
    ask({.kind = LineRequest::Kind::last_break}, told);
  }
  EXPECT_EQ(line->journal(), "[break-]");
  EXPECT_EQ(told, "0,0,0 ") << "not the device's error";
  EXPECT_EQ(times_told("a break is left out, since the device does not take the bytes before it"), 1U);
}

// While it lives, no thread can be started: a stack of that size is not to be had.
class NoThreads {
 public:
  NoThreads() {
    EXPECT_EQ(::pthread_getattr_default_np(&before_), 0);
    pthread_attr_t none;
    EXPECT_EQ(::pthread_getattr_default_np(&none), 0);
    EXPECT_EQ(::pthread_attr_setstacksize(&none, std::size_t{1} << 60), 0);
    EXPECT_EQ(::pthread_setattr_default_np(&none), 0);
    ::pthread_attr_destroy(&none);
  }
  ~NoThreads() {
    ::pthread_setattr_default_np(&before_);
    ::pthread_attr_destroy(&before_);
  }
  NoThreads(const NoThreads&) = delete;
  NoThreads& operator=(const NoThreads&) = delete;

 private:
  pthread_attr_t before_{};
};

TEST_F(SerialSignalsTest, WithoutAThreadTheCloseWaitsForNothingAndTellsWhatThatCost) {
  start();
  line->queued = 1;
  const NoThreads none;
  port->close();
  EXPECT_EQ(log.dropped, 1U);
  EXPECT_EQ(log.why, "no thread was to be had to wait until the device has sent them");
}

TEST_F(SerialSignalsTest, WithoutAThreadTheCloseOfALineThatHasSentAllCostsNothing) {
  start();
  const NoThreads none;
  port->close();
  EXPECT_EQ(log.why, "");
}

TEST_F(SerialSignalsTest, ABreakThatTheDriverLeftEndsWhenItCloses) {
  start({{"baud", "4800"}, {"alwaysopen", "1"}});
  port->tell(LineSignal{Name::brk, true});
  port->close();
  until_journal("(sent)[break+][break-]");
}

TEST_F(SerialSignalsTest, WhatTheDriverLeftIsTakenBackWhereTheLineStaysOpen) {
  start({{"baud", "4800"}, {"alwaysopen", "1"}, {"rts", "off"}});
  port->tell(LineSignal{Name::dtr, false});
  port->tell(LineSignal{Name::rts, true});
  port->close();
  until_journal("[dtr-][rts+][dtr+][rts-]");
  port->open();
  port->close();
  port->open();
  port->write(as_bytes("a"));
  until_journal("[dtr-][rts+][dtr+][rts-]a");
}

TEST_F(SerialSignalsTest, WhatTheDriverDroveIsDrivenAgainWhenTheDeviceComesBack) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "ttyBack").string();
  std::filesystem::create_symlink(path, link);
  start({{"device", link}, {"alwaysopen", "1"}, {"baud", "4800"}});
  port->tell(LineSignal{Name::dtr, true});
  port->tell(LineSignal{Name::rts, false});
  port->tell(LineSignal{Name::cts, false});  // which the device drives
  std::string told;
  ask(made_rs485(3), told);
  until_journal("[dtr+][rts-][set rs485]");
  until_told(told, "0,0,3 ");
  UniqueFd other(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(other.get());
  ::unlockpt(other.get());
  line->device = -1;
  device.reset();
  until_events("up interrupted ");
  port->tell(LineSignal{Name::dtr, false});
  line->device = other.get();
  std::filesystem::remove(link);
  std::filesystem::create_symlink(::ptsname(other.get()), link);
  until_events("up interrupted resumed ");
  port->write(as_bytes("a"));
  until_journal("[dtr+][rts-][set rs485][dtr-][rts-][set rs485]a");
  line->device = -1;
  device = std::move(other);
}

TEST_F(SerialSignalsTest, WhatADriverMadeOfTheDeviceIsNotMadeAgainForTheNextOne) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "ttyBack").string();
  std::filesystem::create_symlink(path, link);
  start({{"device", link}, {"alwaysopen", "1"}, {"baud", "4800"}});
  std::string told;
  ask(made_rs485(3), told);
  until_told(told, "0,0,3 ");
  port->close();
  port->open();
  UniqueFd other(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(other.get());
  ::unlockpt(other.get());
  line->device = -1;
  device.reset();
  until_events("up up interrupted ");
  line->device = other.get();
  std::filesystem::remove(link);
  std::filesystem::create_symlink(::ptsname(other.get()), link);
  until_events("up up interrupted resumed ");
  port->write(as_bytes("a"));
  until_journal("[set rs485]a");
  line->device = -1;
  device = std::move(other);
}

TEST_F(SerialSignalsTest, ADrainIsBehindTheBytes) {
  start();
  const std::string block(4096, 'b');
  while (!port->congested()) port->write(as_bytes(block));
  int done = 0;
  drain(done);
  EXPECT_EQ(done, 0);
  std::string all;
  run_until(loop, [&] {
    all = line->journal();
    return done > 0;
  });
  EXPECT_FALSE(port->congested());
  EXPECT_TRUE(line->journal().ends_with("(sent)"));
}

TEST_F(SerialSignalsTest, ADrainWaitsForTheKernelAndHoldsUpNothing) {
  start();
  line->queued = 100;
  int done = 0;
  drain(done);
  port->write(as_bytes("a"));
  port->tell(LineSignal{Name::rts, true});
  ASSERT_TRUE(port->apply({.baud = 1200}).has_value());
  port->write(as_bytes("b"));
  until_journal("a[rts+](sent)b");
  EXPECT_EQ(done, 0);
  line->queued = 0;
  until_done(done);
  EXPECT_EQ(line->journal(), "a[rts+](sent)b(sent)");
}

TEST_F(SerialSignalsTest, DrainsAreDoneInTurn) {
  start();
  std::string order;
  line->queued = 1;
  for (const char* const name : {"1", "2", "3"}) log.drain(*port, [&order, name] { order += name; });
  line->queued = 0;
  run_until(loop, [&] { return order.size() == 3; });
  EXPECT_EQ(order, "123");
}

TEST_F(SerialSignalsTest, ADrainIsDoneWhenTheLineIsClosed) {
  start();
  line->queued = 100;
  int done = 0;
  drain(done);
  port->close();
  until_done(done);
}

TEST_F(SerialSignalsTest, ADrainIsDoneWhenASessionOfOneThatStaysOpenEnds) {
  start({{"baud", "4800"}, {"alwaysopen", "1"}});
  line->queued = 100;
  int done = 0;
  drain(done);
  port->close();
  until_done(done);
}

TEST_F(SerialSignalsTest, ADrainIsDoneWhenTheDeviceIsLost) {
  start();
  line->queued = 100;
  int done = 0;
  drain(done);
  device.reset();
  line->device = -1;
  until_done(done);
  EXPECT_EQ(log.events, "up lost ");
}

TEST_F(SerialSignalsTest, ADrainWhoseLastBytesAreOnTheirWayIsDoneOnce) {
  start();
  int done = 0;
  drain(done);
  port->close();
  until_done(done);
  port->open();
  run_until(loop, [&] { return log.events == "up up "; });
  EXPECT_EQ(done, 1);
}

TEST_F(SerialSignalsTest, TheDevicesAreToldWhenTheLineComesUp) {
  line->change(TIOCM_CTS | TIOCM_DSR, {}, false);
  make();
  port->tell(line::WatchSignals{true});
  ASSERT_EQ(::write(device.get(), "x", 1), 1);  // as early as a device can
  port->open();
  EXPECT_EQ(log.events, "up cts+ dsr+ cd- ri- ");
  line->change(TIOCM_CTS);
  until_events("up cts+ dsr+ cd- ri- dsr- ");
  port->close();
  port->open();
  until_events("up cts+ dsr+ cd- ri- dsr- up cts+ dsr- cd- ri- ");
}

TEST_F(SerialSignalsTest, TheDevicesAreToldBehindWhatCameBefore) {
  make();
  port->tell(line::WatchSignals{true});
  port->open();
  run_until(loop, [&] {
    loop.post([] {});
    return line->waits > 0;
  });
  ASSERT_EQ(::write(device.get(), "before", 6), 6);
  line->change(TIOCM_CD);
  run_until(loop, [&] { return log.events.ends_with("cd+ "); });
  EXPECT_EQ(log.data, "before");
}

TEST_F(SerialSignalsTest, TheDevicesAreNotToldUnlessTheyAreWanted) {
  start();
  line->change(TIOCM_CTS);
  port->write(as_bytes("a"));
  until_journal("a");
  EXPECT_EQ(line->looks, 0);
  port->tell(line::WatchSignals{true});
  until_events("up cts+ dsr- cd- ri- ");
  port->tell(line::WatchSignals{false});
  line->change(0);
  port->tell(LineSignal{Name::rts, true});
  until_journal("a[rts+]");
  EXPECT_EQ(log.events, "up cts+ dsr- cd- ri- ");
}

TEST_F(SerialSignalsTest, OneThatStaysOpenTellsThemToEachSession) {
  make({{"baud", "4800"}, {"alwaysopen", "1"}}, true);
  run_until(loop, [&] {
    loop.post([] {});
    return line->waits > 0;
  });
  EXPECT_EQ(log.events, "");
  port->open();
  EXPECT_EQ(log.events, "up cts- dsr- cd- ri- ");
  port->close();
  const int waits = line->waits;
  line->change(TIOCM_CTS);
  run_until(loop, [&] {
    loop.post([] {});
    return line->waits > waits;
  });
  while (loop.poll_one()) {
  }
  port->open();
  EXPECT_EQ(log.events, "up cts- dsr- cd- ri- up cts+ dsr- cd- ri- ");
}

TEST_F(SerialSignalsTest, OneThatIsOpenAlreadyTellsThemAtTheNextOpen) {
  make({{"baud", "4800"}, {"alwaysopen", "1"}});
  line->change(TIOCM_CTS, {}, false);
  port->tell(line::WatchSignals{true});
  port->open();
  EXPECT_EQ(log.events, "up cts+ dsr- cd- ri- ");
}

TEST_F(SerialSignalsTest, TheyAreToldAgainWhenTheDeviceComesBack) {
  const test::TempDir dir;
  const std::string link = (dir.path() / "ttyBack").string();
  std::filesystem::create_symlink(path, link);
  make({{"device", link}, {"alwaysopen", "1"}, {"baud", "4800"}}, true);
  port->open();
  EXPECT_EQ(log.events, "up cts- dsr- cd- ri- ");
  log.events.clear();
  UniqueFd other(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(other.get());
  ::unlockpt(other.get());
  line->device = -1;
  device.reset();
  until_events("interrupted ");
  line->change(TIOCM_CD, {}, false);
  std::filesystem::remove(link);
  std::filesystem::create_symlink(::ptsname(other.get()), link);
  until_events("interrupted resumed cts- dsr- cd+ ri- ");
  device = std::move(other);
}

TEST_F(SerialSignalsTest, ADeviceThatHangsInAWaitHoldsUpTheNextOpenAlone) {
  line->hang();
  make();
  port->tell(line::WatchSignals{true});
  port->open();
  run_until(loop, [&] {
    loop.post([] {});
    return line->waits > 0;
  });
  port->close();
  port->open();
  bool turned = false;
  loop.post([&turned] { turned = true; });
  run_until(loop, [&] { return turned; });
  line->release();
  until_events("up cts- dsr- cd- ri- up cts- dsr- cd- ri- ");
}

TEST_F(SerialSignalsTest, OneThatIsWatchedIsOpenedAgainAtOnce) {
  make();
  port->tell(line::WatchSignals{true});
  std::string events;
  for (int i = 0; i < 50; ++i) {
    port->open();
    events += "up cts- dsr- cd- ri- ";
    until_events(events);
    port->close();
  }
}

}  // namespace
}  // namespace porttape
