// A real program on a real pty, under the supervisor: what it finds, and what the line's port is told.

#include "libport/supervise/tty_calls.hpp"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <functional>
#include <linux/serial.h>
#include <memory>
#include <sstream>
#include <string>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/line/line_settings_text.hpp"
#include "libport/supervise/caller_rights.hpp"
#include "libport/supervise/supervised_command.hpp"
#include "libport/supervise/uart_model.hpp"
#include "tests/support/temp_dir.hpp"

extern char** environ;

namespace porttape {
namespace {

using Name = LineSignal::Name;

// A pty as its port has it, without a session.
class PtyLine final : public SupervisedLine {
 public:
  PtyLine() : master_(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    ::grantpt(master_.get());
    ::unlockpt(master_.get());
    path = ::ptsname(master_.get());
    device_ = tty_device_at(path);
  }

  void supervise(LineSupervisor* by) override { supervisor = by; }
  [[nodiscard]] int line_fd() const override { return master_.get(); }
  [[nodiscard]] std::optional<TtyDevice> line_device() const override { return device_; }
  bool catch_up() override {
    std::array<char, 256> some{};
    const ssize_t size = takes ? ::read(master_.get(), some.data(), some.size()) : -1;
    if (size > 0) say("wrote " + std::string(some.data(), static_cast<std::size_t>(size)));
    if (size > 0) passed_on_ += static_cast<std::uint64_t>(size);
    if (slow_looks > 0) {
      ++passed_on_;
      takes = --slow_looks == 0;
    }
    return takes;
  }
  [[nodiscard]] std::uint64_t passed_on() const override { return passed_on_; }
  void peer_did(const LineEvent& event) override {
    std::visit(
        LineVisitor{
            [this](const line::Settings& settings) {
              termios shown{};  // as PtyPort does, for its looks
              ::ioctl(line_fd(), TCGETS, &shown);
              shown.c_cflag &= ~static_cast<tcflag_t>(CLOCAL);
              ::ioctl(line_fd(), TCSETS, &shown);
              say(to_text(settings.seen) + (settings.order == SettingsOrder::sampled ? " sampled" : ""));
            },
            [this](const line::Flush& flush) {
              say(std::string("flushed") + (flush.queue != FlushQueue::out ? " in" : "") +
                  (flush.queue != FlushQueue::in ? " out" : ""));
            },
            [this](const LineSignal& signal) {
              say(std::string(name_of(signal.name)) + (signal.on ? " on" : " off"));
              if (on_signal) on_signal(signal);
            },
            [](const auto&) { FAIL() << "it is no request"; },
        },
        event);
  }
  void wait_until_sent(std::function<void()> done) override {
    if (!holds) return done();
    held = std::move(done);
    on_held();
  }

  void ask(const LineRequest& request, TakeAnswer done) override {
    const bool makes =
        request.kind == LineRequest::Kind::set_serial || request.kind == LineRequest::Kind::set_rs485;
    if (makes) say(request.kind == LineRequest::Kind::set_rs485 ? "made rs485" : "made serial");
    done(answer);
  }

  void say(std::string what) { told.push_back(std::move(what)); }

  std::string path;
  LineSupervisor* supervisor = nullptr;
  std::vector<std::string> told;
  bool takes = true;
  int slow_looks = 0;  // so often it is seen to get on; then it takes all
  bool holds = false;
  std::function<void()> held;
  std::function<void()> on_held = [] {};
  std::function<void(const LineSignal&)> on_signal;
  std::optional<LineAnswer> answer;  // the device's, to all that it is asked

 private:
  UniqueFd master_;
  std::optional<TtyDevice> device_;
  std::uint64_t passed_on_ = 0;
};

std::vector<std::string> environment_here() {
  std::vector<std::string> all;
  for (char** entry = environ; *entry != nullptr; ++entry) all.emplace_back(*entry);
  return all;
}

class TtyCallsTest : public testing::Test {
 public:
  // Runs the steps and gives what came of them, a line each.
  std::vector<std::string> run(const std::vector<std::string>& steps, const LineDefaults& lines = {}) {
    std::vector<std::string> command{TTY_PROGRAM, line.path, dir / "result"};
    command.insert(command.end(), steps.begin(), steps.end());
    std::vector<std::unique_ptr<CallPart>> parts;
    parts.push_back(std::make_unique<TtyCalls>(line, lines, nullptr));
    line.supervisor->line_opened();
    if (before_start) before_start();
    SupervisedCommand::Trouble trouble;
    bool over = false;
    const auto running = SupervisedCommand::start(
        loop, {.command = command, .environment = environment_here(), .traps = Supervisor::traps(parts)},
        [&](int wait_status) {
          status = wait_status;
          over = true;
        },
        trouble);
    if (!running) {
      ADD_FAILURE() << trouble.message;
      return {};
    }
    const Supervisor supervisor(loop, running->take_listener(), std::move(parts));
    while (!over) loop.run_one();
    return lines_of(dir / "result");
  }

  static std::vector<std::string> lines_of(const std::string& path) {
    std::vector<std::string> all;
    std::ifstream file(path);
    for (std::string text; std::getline(file, text);) all.push_back(text);
    return all;
  }

  Loop loop;
  test::TempDir dir;
  PtyLine line;
  int status = -1;
  std::function<void()> before_start;
  // Again and again: the first may come before the driver waits.
  bool cts = true;
  Timer later{loop, [this] {
                line.supervisor->line_signalled({Name::cts, cts = !cts});
                later.set_after(std::chrono::milliseconds(5));
              }};
  Timer gone{loop, [this] {
               line.supervisor->line_closed();
               gone.set_after(std::chrono::milliseconds(5));
             }};
};

using testing::ElementsAre;

TEST_F(TtyCallsTest, ADriverReadsModemLines) {
  EXPECT_THAT(run({"lines"}), ElementsAre("lines 0 dtr rts cts dsr cd"));
  EXPECT_EQ(status, 0);
  EXPECT_THAT(run({"lines"}, {.cts = false, .dsr = false, .cd = false, .ri = true}),
              ElementsAre("lines 0 dtr rts ri"));
}

TEST_F(TtyCallsTest, WhatItDrivesIsToldBehindWhatItWrote) {
  EXPECT_THAT(run({"write:a", "rts-", "rts-", "write:b", "dtr-", "lines"}),
              ElementsAre("write 1", "write 1", "lines 0 cts dsr cd"));
  EXPECT_THAT(line.told, ElementsAre("wrote a", "rts off", "wrote b", "dtr off"));
}

TEST_F(TtyCallsTest, ParityAndDataBitsAreReadBackAndHaveTheirPlace) {
  EXPECT_THAT(run({"write:x", "set:8E", "write:y", "set:7O", "set:7O", "set:8N"}),
              ElementsAre("write 1", "set 0 8E", "write 1", "set 0 7O", "set 0 7O", "set 0 8N"));
  EXPECT_THAT(line.told, ElementsAre("wrote x", "19200 baud, 8E1", "wrote y", "19200 baud, 7O1",
                                     "19200 baud, 7O1", "19200 baud, 8N1"));
}

TEST_F(TtyCallsTest, EachFormOfSettingsHasItsPlaceAndIsReadBack) {
  EXPECT_THAT(run({"write:x", "forms"}),
              ElementsAre("write 1", "TCSETS 0 0 7E", "TCSETSW 0 0 8O", "TCSETSF 0 0 7E", "TCSETA 0 0 8O",
                          "TCSETAW 0 0 7E", "TCSETAF 0 0 8O", "TCSETS2 0 0 7E", "TCSETSW2 0 0 8O",
                          "TCSETSF2 0 0 7E"));
  EXPECT_THAT(line.told,
              ElementsAre("wrote x", "9600 baud, 7E1", "9600 baud, 8O1", "flushed in", "9600 baud, 7E1",
                          "9600 baud, 8O1", "9600 baud, 7E1", "flushed in", "9600 baud, 8O1",
                          "9600 baud, 7E1", "9600 baud, 8O1", "flushed in", "9600 baud, 7E1"));
}

// The device may have its settings from elsewhere.
TEST_F(TtyCallsTest, WhatTheLineShowsIsReadBack) {
  struct Shown {
    unsigned data_bits;
    Parity parity;
    const char* frame;
  };
  for (const Shown& shown :
       {Shown{5, Parity::none, "5N"}, Shown{6, Parity::even, "6E"}, Shown{7, Parity::odd, "7O"},
        Shown{8, Parity::mark, "8M"}, Shown{8, Parity::space, "8S"}, Shown{9, Parity::none, "8N"}}) {
    before_start = [&] {
      line.supervisor->line_shows({.data_bits = shown.data_bits, .parity = shown.parity});
    };
    EXPECT_THAT(run({"shown"}), ElementsAre(std::string("shown 0 ") + shown.frame));
  }
}

// As a serial line is opened: a pty of ours has a flag by which the kernel knows a change.
TEST_F(TtyCallsTest, UntilItSetsTheLineADriverSeesNoMarkOfIt) {
  before_start = [this] {
    termios made{};
    ::ioctl(line.line_fd(), TCGETS, &made);
    made.c_iflag |= IGNBRK;
    ::ioctl(line.line_fd(), TCSETS, &made);
  };
  EXPECT_THAT(run({"shown"}), ElementsAre("shown 0 8N"));
}

TEST_F(TtyCallsTest, ARateOfNoneLowersItsLinesAndAnotherRaisesThem) {
  EXPECT_THAT(run({"rate:0", "lines", "rate:0", "rts+", "rate:4800", "lines"}),
              ElementsAre("rate 0", "lines 0 cts dsr cd", "rate 0", "rate 0", "lines 0 dtr rts cts dsr cd"));
}

TEST_F(TtyCallsTest, AllLinesThatADriverDrivesAreSetAtOnce) {
  EXPECT_THAT(run({"lines=rts", "lines", "lines=dtr", "lines=dtr", "lines", "lines=", "dtr+", "lines"}),
              ElementsAre("lines= 0", "lines 0 rts cts dsr cd", "lines= 0", "lines= 0",
                          "lines 0 dtr cts dsr cd", "lines= 0", "lines 0 dtr cts dsr cd"));
  EXPECT_THAT(line.told, ElementsAre("dtr off", "dtr on", "rts off", "dtr off", "dtr on"));
}

// The others change for a while before it does.
TEST_F(TtyCallsTest, AWaitIsForTheLineThatItNames) {
  const std::vector<std::pair<std::string, Name>> inputs{
      {"cts", Name::cts}, {"dsr", Name::dsr}, {"cd", Name::cd}, {"ri", Name::ri}};
  for (const auto& [waited, name] : inputs) {
    int round = 0;
    Timer changes(loop, [&, name = name] {
      for (const auto& [text, other] : inputs) {
        if (other != name || round > 10) line.supervisor->line_signalled({other, round % 2 != 0});
      }
      ++round;
      changes.set_after(std::chrono::milliseconds(3));
    });
    line.on_signal = [&](const LineSignal&) { changes.set_after(std::chrono::milliseconds(1)); };
    const std::vector<std::string> said = run({"rts-", "wait:" + waited, "counts"});
    changes.cancel();
    ASSERT_EQ(said.size(), 2U);
    EXPECT_EQ(said[0], "wait 0 0");
    EXPECT_THAT(said[1], testing::StartsWith("counts 0 "));
    EXPECT_THAT(said[1], testing::Not(testing::HasSubstr(waited + " 0"))) << said[1];
  }
}

TEST_F(TtyCallsTest, ACountIsOfEachLine) {
  before_start = [this] {
    const auto change = [this](Name name, int times) {
      for (int i = 0; i < times; ++i) {
        line.supervisor->line_signalled({name, false});
        line.supervisor->line_signalled({name, true});
      }
    };
    change(Name::cts, 1);
    change(Name::dsr, 2);
    change(Name::cd, 3);
    change(Name::ri, 5);
    change(Name::brk, 6);
  };
  EXPECT_THAT(run({"counts"}), ElementsAre("counts 0 cts 2 dsr 4 cd 6 ri 4 brk 6"));
}

TEST_F(TtyCallsTest, WhetherALineIsLocalIsReadBack) {
  EXPECT_THAT(run({"set:8N", "set:8Nc", "set:7E"}), ElementsAre("set 0 8N", "set 0 8Nc", "set 0 7E"));
}

TEST_F(TtyCallsTest, ADrainLastsUntilTheDeviceHasAll) {
  line.holds = true;
  Timer sent(loop, [this] {
    line.say("sent");
    line.held();
  });
  line.on_held = [&] { sent.set_after(std::chrono::milliseconds(5)); };
  EXPECT_THAT(run({"write:x", "drain"}), ElementsAre("write 1", "drain 0"));
  EXPECT_THAT(line.told, ElementsAre("wrote x", "sent"));
}

TEST_F(TtyCallsTest, TheControllingTerminalIsThePort) {
  EXPECT_THAT(run({"session", "lines", "set:7E", "write:x", "flush"}),
              ElementsAre("lines 0 dtr rts cts dsr cd", "set 0 7E", "write 1", "flush 0"));
  EXPECT_EQ(status, 0);
  EXPECT_THAT(line.told, ElementsAre("19200 baud, 7E1", "wrote x", "flushed in out"));
}

TEST_F(TtyCallsTest, ABreakBeginsAndEnds) {
  EXPECT_THAT(run({"break"}), ElementsAre("break 0 0"));
  EXPECT_THAT(line.told, ElementsAre("break on", "break off"));
}

TEST_F(TtyCallsTest, ABreakThatTheDeviceRefusesIsTheDriversError) {
  line.answer = LineAnswer{.error = EIO};
  EXPECT_THAT(run({"break", "break+"}), ElementsAre("break -1 EIO", "break+ -1 EIO"));
  EXPECT_THAT(line.told, ElementsAre("break on", "break off", "break on", "break off"));
}

TEST_F(TtyCallsTest, ADeviceThatKnowsNoBreaksIsAnErrorWhereTheKernelHasItSo) {
  line.answer = LineAnswer{.error = EOPNOTSUPP};
  EXPECT_THAT(run({"break", "break+"}), ElementsAre("break 0 0", "break+ -1 EOPNOTSUPP"));
}

TEST_F(TtyCallsTest, WhatADeviceSaysOfItsUartIsTheDriversAnswer) {
  line.answer = LineAnswer{};
  line.answer->serial.type = PORT_16850;
  line.answer->rs485.flags = SER_RS485_ENABLED;
  line.answer->rs485.delay_rts_after_send = 7;  // it has no other
  EXPECT_THAT(run({"write:a", "serial", "rs485"}),
              ElementsAre("write 1", "serial 0 type 12", "rs485 0 after 7, 0 after 7"));
  EXPECT_THAT(line.told, ElementsAre("wrote a", "made serial", "made rs485"));
}

TEST_F(TtyCallsTest, WhatADeviceRefusesOfItIsTheDriversError) {
  line.answer = LineAnswer{.error = ENOTTY};
  EXPECT_THAT(run({"serial", "rs485"}), ElementsAre("serial -1 ENOTTY", "rs485 -1 ENOTTY"));
}

// porttape may have more rights than a driver that has given up its own.
TEST_F(TtyCallsTest, ADriverWithoutRightsChangesOfItsUartWhatAnybodyMay) {
  line.answer = LineAnswer{};
  line.answer->serial.type = PORT_16850;
  line.answer->serial.close_delay = 50;
  EXPECT_THAT(run({"give-up-rights", "serial", "delay"}),
              ElementsAre("rights 0", "serial 0 type 12", "delay -1 EPERM"));
  EXPECT_THAT(line.told, ElementsAre("made serial"));
  line.told.clear();
  line.answer.reset();
  EXPECT_THAT(run({"give-up-rights", "serial", "delay"}),
              ElementsAre("rights 0", "serial 0 type 4", "delay -1 EPERM"));
}

TEST_F(TtyCallsTest, AnAdministratorChangesAllOfIt) {
  if (!is_administrator(::gettid())) GTEST_SKIP() << "this test needs CAP_SYS_ADMIN";
  EXPECT_THAT(run({"delay", "delay"}), ElementsAre("delay 0 0", "delay 0 0"));
  EXPECT_THAT(line.told, ElementsAre("made serial", "made serial"));
}

TEST(UartModel, AnybodyMayChangeTheFlagsForAllAndTheDivisor) {
  const serial_struct now = UartModel().serial();
  const auto may = [now](const auto& change) {
    serial_struct wanted = now;
    change(wanted);
    return UartModel::may_anybody(now, wanted);
  };
  EXPECT_TRUE(may([](serial_struct&) {}));
  EXPECT_TRUE(may([](serial_struct& wanted) { wanted.flags += static_cast<int>(ASYNC_LOW_LATENCY); }));
  EXPECT_TRUE(may([](serial_struct& wanted) { wanted.flags += static_cast<int>(ASYNC_SPD_CUST); }));
  EXPECT_TRUE(may([](serial_struct& wanted) { wanted.custom_divisor = 7; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.flags += static_cast<int>(ASYNC_SAK); }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.type = PORT_8250; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.port = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.port_high = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.irq = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.io_type = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.hub6 = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.iomem_reg_shift = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.baud_base = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.xmit_fifo_size = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.close_delay = 1; }));
  EXPECT_FALSE(may([](serial_struct& wanted) { wanted.closing_wait = 1; }));
}

TEST_F(TtyCallsTest, WithoutASerialDeviceTheDriverIsGivenBackWhatItMade) {
  EXPECT_THAT(run({"serial", "rs485"}), ElementsAre("serial 0 type 4", "rs485 0 after 3, 0 after 3"));
}

TEST_F(TtyCallsTest, AWaitForALineEndsWithItsChange) {
  line.on_signal = [this](const LineSignal&) {
    loop.post([this] { later.set_after(std::chrono::milliseconds(5)); });
  };
  EXPECT_THAT(run({"rts-", "wait", "count"}), ElementsAre("wait 0 0", testing::StartsWith("count 0 cts ")));
}

TEST_F(TtyCallsTest, ASignalEndsAWait) {
  EXPECT_THAT(run({"alarm:20", "wait"}), ElementsAre("wait -1 EINTR"));
}

TEST_F(TtyCallsTest, SignalsEndWaitsOfOneOfManyThreadsWhoeverSendsThem) {
  EXPECT_THAT(run({"crowd:1500"}), ElementsAre("beside 0", "thread EINTR", "timer EINTR", "process EINTR"));
}

// As the kernel has it, a handler's SA_RESTART or not: a second break would reach the device.
TEST_F(TtyCallsTest, ASignalEndsABreakForGood) {
  EXPECT_THAT(run({"alarm:20r", "break:50"}), ElementsAre("break -1 EINTR"));
  EXPECT_THAT(line.told, ElementsAre("break on", "break off"));
}

TEST_F(TtyCallsTest, TheLinesEndEndsAWait) {
  line.on_signal = [this](const LineSignal&) {
    loop.post([this] { gone.set_after(std::chrono::milliseconds(5)); });
  };
  EXPECT_THAT(run({"rts-", "wait"}), ElementsAre("wait -1 EIO"));
}

TEST_F(TtyCallsTest, AFlushHasItsPlace) {
  EXPECT_THAT(run({"write:a", "flush", "write:b", "rts-"}), ElementsAre("write 1", "flush 0", "write 1"));
  EXPECT_THAT(line.told, ElementsAre("wrote a", "flushed in out", "wrote b", "rts off"));
}

TEST_F(TtyCallsTest, TheLinesThatAUserAsksForAreTold) {
  EXPECT_THAT(run({"rts-", "lines"}, {.cts = false, .dsr = false, .cd = false, .loopback = true}),
              ElementsAre("lines 0 dtr dsr cd"));
  EXPECT_THAT(line.told, ElementsAre("cts on", "dsr on", "cd on", "ri off", "rts off", "cts off"));
}

TEST_F(TtyCallsTest, ANumberThatIsAnotherFileNowIsNotThePort) {
  EXPECT_THAT(run({"lines", "other", "lines"}), ElementsAre("lines 0 dtr rts cts dsr cd", "other -1 ENOTTY",
                                                            "closed -1 EBADF", "lines 0 dtr rts cts dsr cd"));
}

TEST_F(TtyCallsTest, ManyProcessesAndAThreadAreAnswered) {
  EXPECT_THAT(
      run({"lines", "children:20", "lines"}),
      ElementsAre("lines 0 dtr rts cts dsr cd", "children 20 thread 1", "lines 0 dtr rts cts dsr cd"));
}

TEST_F(TtyCallsTest, AThreadIsAnsweredInTheProgramThatItBecomes) {
  EXPECT_THAT(run({"lines", "exec", "rts-", "lines", "set:7E"}),
              ElementsAre("lines 0 dtr rts cts dsr cd", "lines 0 dtr cts dsr cd", "set 0 7E"));
}

TEST_F(TtyCallsTest, ABadAddressIsTheDriversOwnError) {
  EXPECT_THAT(run({"bad"}), ElementsAre("bad -1 EFAULT"));
}

TEST_F(TtyCallsTest, ADeviceThatTakesNothingHoldsAChangeUpForAWhileOnly) {
  line.takes = false;
  EXPECT_THAT(run({"write:x", "set:8E"}), ElementsAre("write 1", "set 0 8E"));
  EXPECT_THAT(line.told, ElementsAre("19200 baud, 8E1 sampled"));
}

// More looks than fit into the time that a device which takes nothing is waited for.
TEST_F(TtyCallsTest, ADeviceThatTakesBytesSlowlyHoldsAChangeUpUntilItHasThem) {
  line.takes = false;
  line.slow_looks = 6000;
  EXPECT_THAT(run({"write:x", "set:8E"}), ElementsAre("write 1", "set 0 8E"));
  EXPECT_THAT(line.told, ElementsAre("19200 baud, 8E1"));
  EXPECT_EQ(line.slow_looks, 0);
}

}  // namespace
}  // namespace porttape
