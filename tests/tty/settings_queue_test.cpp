// By a clock that is moved: what a change of the line waits for, and how long.

#include "libport/tty/settings_queue.hpp"

#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <memory>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/tty/played_line.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr LineSignal kBreak{LineSignal::Name::brk, true};
constexpr LineSignal kNoBreak{LineSignal::Name::brk, false};
constexpr LineSignal kRts{LineSignal::Name::rts, true};

// The settings are those of a pty. The bytes go to a socket, which takes nothing until it is read: a pty
// hands on what it has when the kernel comes to it.
class SettingsQueueTest : public testing::Test {
 protected:
  SettingsQueueTest() {
    const int unlocked = 0;
    EXPECT_EQ(::ioctl(master.get(), TIOCSPTLCK, &unlocked), 0);
    tty.reset(::ioctl(master.get(), TIOCGPTPEER, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends), 0);
    line.reset(ends[0]);
    device.reset(ends[1]);
    EXPECT_TRUE(apply_settings(tty.get(), usual).has_value());
    watch = std::make_unique<FdWatch>(
        loop, line.get(), [] {}, [this] { outbox->flush(); });
    outbox = std::make_unique<Outbox>(
        line.get(), Outbox::Kind::socket, *watch, [this] { queue->outbox_drained(); },
        [](int error_number, std::size_t) { ADD_FAILURE() << error_number; });
    queue = std::make_unique<SettingsQueue>(
        loop, SettingsQueue::Tty{tty.get(), *outbox, Workers::Strand(), calls}, usual,
        SettingsQueue::Told{[this](const LineSettings& wanted, const Result<TakenSettings>&) {
                              told += std::to_string(wanted.baud) + " ";
                            },
                            [this](const LineSignal& signal, int error_number) {
                              told += std::string(name_of(signal.name)) + (signal.on ? "+" : "-") +
                                      (error_number == 0 ? "" : "!" + std::to_string(error_number)) + " ";
                            },
                            [this] { told += "drained "; }});
  }
  // More than the kernel takes.
  void congest() {
    queue->write(Bytes(std::size_t{1} << 20, Byte{'x'}));
    ASSERT_TRUE(outbox->congested());
    settle(loop);
  }
  // What has come to the device by now.
  std::string come() const {
    std::string all;
    std::string block(65536, '\0');
    for (ssize_t n = 0; (n = ::read(device.get(), block.data(), block.size())) > 0;)
      all.append(block, 0, static_cast<std::size_t>(n));
    return all;
  }
  // Until nothing is left here.
  std::string all_come() {
    std::string all;
    while (outbox->congested()) {
      all += come();
      settle(loop);
    }
    return all + come();
  }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }
  // How long until the queue looks again.
  Nanos next_look() { return loop.next_timer().value_or(Instant{}) - clock.now(); }

  const LineSettings usual{.baud = 9600};
  ManualClock clock;
  Loop loop{clock};
  UniqueFd master{::open("/dev/ptmx", O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
  UniqueFd tty;
  UniqueFd line;
  UniqueFd device;
  std::shared_ptr<PlayedLine> calls = std::make_shared<PlayedLine>();
  std::string told;
  std::unique_ptr<FdWatch> watch;
  std::unique_ptr<Outbox> outbox;
  std::unique_ptr<SettingsQueue> queue;
};

TEST_F(SettingsQueueTest, AChangeOfAnIdleLineIsMadeBehindWhatTheDeviceSends) {
  queue->change({.baud = 4800});
  EXPECT_EQ(told, "") << "not from within the call";
  EXPECT_EQ(queue->settings().baud, 4800U);
  EXPECT_EQ(queue->left(), std::vector<LineSettings>{{.baud = 4800}});
  settle(loop);
  EXPECT_EQ(told, "4800 ");
  EXPECT_EQ(calls->journal(), "(sent)");
  EXPECT_TRUE(queue->left().empty());
  EXPECT_EQ(queue->settings().baud, 4800U);
}

TEST_F(SettingsQueueTest, ALineThatStandsStillHoldsUpAChangeForASecond) {
  congest();
  queue->change({.baud = 4800});
  pass(seconds(1) - Nanos(1));
  EXPECT_EQ(told, "");
  pass(Nanos(1));
  EXPECT_EQ(told, "4800 ");
  EXPECT_EQ(calls->journal(), "") << "nobody waits for its bytes once more";
}

TEST_F(SettingsQueueTest, ALineThatGetsOnHoldsUpAChangeForAsLongAsItDoes) {
  congest();
  queue->change({.baud = 4800});
  for (int n = 0; n < 3; ++n) {
    pass(milliseconds(900));
    ASSERT_FALSE(come().empty());
    settle(loop);
    pass(milliseconds(100));
    EXPECT_EQ(told, "") << n;
  }
  pass(seconds(1));
  EXPECT_EQ(told, "4800 ");
}

TEST_F(SettingsQueueTest, FlowControlAloneWaitsForNothing) {
  congest();
  queue->change({.baud = 9600, .hw_flow = true, .sw_flow = true});
  settle(loop);
  EXPECT_EQ(told, "9600 ");
  EXPECT_EQ(calls->journal(), "");
}

TEST_F(SettingsQueueTest, AQuestionWaitsForNothing) {
  congest();
  std::optional<LineAnswer> answer;
  queue->ask({.kind = LineRequest::Kind::get_serial}, [&](const auto& got) { answer = got; });
  settle(loop);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->error, 0);
}

TEST_F(SettingsQueueTest, OfSeveralChangesWithNoByteBetweenThemTheLastCounts) {
  congest();
  queue->change({.baud = 4800});
  queue->change({.baud = 2400});
  EXPECT_EQ(queue->left().size(), 1U);
  pass(seconds(1));
  EXPECT_EQ(told, "2400 ");
}

TEST_F(SettingsQueueTest, AChangeThatBecomesOneOfFlowControlAloneWaitsNoLonger) {
  congest();
  queue->change({.baud = 4800});
  settle(loop);
  EXPECT_EQ(told, "");
  queue->change({.baud = 9600, .hw_flow = true});
  settle(loop);
  EXPECT_EQ(told, "9600 ");
  EXPECT_TRUE(queue->left().empty());
}

TEST_F(SettingsQueueTest, AChangeBehindAByteIsMadeForItself) {
  congest();
  queue->change({.baud = 4800});
  queue->write(as_bytes("between"));
  queue->change({.baud = 2400});
  EXPECT_EQ(queue->left().size(), 2U);
  EXPECT_EQ(queue->settings().baud, 2400U);
  EXPECT_EQ(queue->pending(), outbox->pending() + 7);
  pass(seconds(2));
  EXPECT_EQ(told.substr(0, 5), "4800 ");
  (void)all_come();
  pass(seconds(2));
  EXPECT_EQ(told, "4800 2400 drained ");
}

TEST_F(SettingsQueueTest, AChangeBehindASignalIsMadeForItself) {
  congest();
  queue->change({.baud = 4800});
  queue->signal(kRts);
  queue->change({.baud = 2400});
  pass(seconds(3));
  EXPECT_EQ(told, "4800 rts+ 2400 ");
}

TEST_F(SettingsQueueTest, AChangeThatIsBeingMadeIsNotTakenBack) {
  queue->change({.baud = 4800});
  queue->change({.baud = 2400});
  EXPECT_EQ(queue->left().size(), 2U);
  settle(loop);
  EXPECT_EQ(told, "4800 2400 ");
}

TEST_F(SettingsQueueTest, BytesBehindAChangeAreWrittenBehindIt) {
  queue->write(as_bytes("before"));
  queue->change({.baud = 4800});
  queue->write(as_bytes("behind"));
  EXPECT_TRUE(queue->congested());
  EXPECT_EQ(come(), "before");
  settle(loop);
  EXPECT_EQ(come(), "behind");
  EXPECT_EQ(told, "4800 drained ");
  EXPECT_FALSE(queue->congested());
}

TEST_F(SettingsQueueTest, SomeThatIsWrittenBehindAChangeIsNotKept) {
  EXPECT_EQ(queue->write_some(as_bytes("before")), 6U);
  EXPECT_FALSE(queue->congested());
  queue->change({.baud = 4800});
  EXPECT_EQ(queue->write_some(as_bytes("behind")), 0U);
  EXPECT_TRUE(queue->congested());
  settle(loop);
  EXPECT_EQ(come(), "before");
  EXPECT_EQ(told, "4800 drained ") << "more can go";
}

TEST_F(SettingsQueueTest, AChangeWithoutBytesBehindItDrainsNothing) {
  queue->change({.baud = 4800});
  EXPECT_FALSE(queue->congested());
  settle(loop);
  EXPECT_EQ(told, "4800 ");
}

TEST_F(SettingsQueueTest, ASignalWaitsForTheKernelAndABreakForTheDevice) {
  queue->signal(kRts);
  settle(loop);
  queue->signal(kBreak);
  EXPECT_TRUE(queue->breaks());
  settle(loop);
  queue->signal(kNoBreak);
  EXPECT_FALSE(queue->breaks());
  settle(loop);
  EXPECT_EQ(told, "rts+ break+ break- ");
  EXPECT_EQ(calls->journal(), "[rts+](sent)[break+][break-]");
}

TEST_F(SettingsQueueTest, ABreakThatCannotFollowItsBytesIsLeftOut) {
  calls->moves = false;
  queue->signal(kBreak);
  settle(loop);
  EXPECT_EQ(told, "break+!" + std::to_string(ETIMEDOUT) + " ");
  EXPECT_EQ(calls->journal(), "");
  std::optional<LineAnswer> answer;
  queue->ask({.kind = LineRequest::Kind::last_break}, [&](const auto& got) { answer = got; });
  settle(loop);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->error, 0) << "that is no error of the device";
}

TEST_F(SettingsQueueTest, ABreakBehindBytesThatStandStillIsLeftOutAfterASecond) {
  congest();
  queue->signal(kBreak);
  pass(seconds(1) - Nanos(1));
  EXPECT_EQ(told, "");
  pass(Nanos(1));
  EXPECT_EQ(told, "break+!" + std::to_string(ETIMEDOUT) + " ");
}

TEST_F(SettingsQueueTest, ASignalBehindBytesThatStandStillIsMadeAfterASecond) {
  congest();
  queue->signal(kRts);
  pass(seconds(1) - Nanos(1));
  EXPECT_EQ(told, "");
  pass(Nanos(1));
  EXPECT_EQ(told, "rts+ ");
}

TEST_F(SettingsQueueTest, TheErrorOfTheLastBreakIsKept) {
  calls->error = EIO;
  queue->signal(kBreak);
  settle(loop);
  calls->error = 0;
  queue->signal(kNoBreak);
  std::optional<LineAnswer> answer;
  queue->ask({.kind = LineRequest::Kind::last_break}, [&](const auto& got) { answer = got; });
  settle(loop);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->error, EIO);
}

TEST_F(SettingsQueueTest, ATtyWithoutSuchAThingAndWithoutModemLinesIsNoSerialDevice) {
  bool answered = false;
  std::optional<LineAnswer> answer;
  const auto ask = [&](int error) {
    calls->ask_error = error;
    answered = false;
    queue->ask({.kind = LineRequest::Kind::get_serial}, [&](const auto& got) {
      answer = got;
      answered = true;
    });
    settle(loop);
    EXPECT_TRUE(answered);
  };
  ask(ENOTTY);
  ASSERT_TRUE(answer.has_value()) << "it has modem lines";
  EXPECT_EQ(answer->error, ENOTTY);
  calls->lose_lines();
  ask(ENOTTY);
  EXPECT_FALSE(answer.has_value());
  ask(EINVAL);
  EXPECT_FALSE(answer.has_value());
  ask(EIO);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->error, EIO);
  ask(0);
  EXPECT_TRUE(answer.has_value());
}

TEST_F(SettingsQueueTest, ADrainIsDoneWhenTheUartHasSentAll) {
  calls->queued = 10;
  bool done = false;
  queue->drain([&done] { done = true; });
  EXPECT_EQ(next_look(), Nanos(10'416'666)) << "so long 10 bytes take at 9600 baud";
  pass(milliseconds(500));
  EXPECT_FALSE(done);
  calls->queued = 0;
  pass(milliseconds(20));
  EXPECT_TRUE(done);
  EXPECT_EQ(calls->journal(), "(sent)") << "the UART's last";
}

TEST_F(SettingsQueueTest, ALineIsLookedAtOnceAMillisecondAtMostAndEachTwentyAtLeast) {
  calls->queued = 1;
  ASSERT_TRUE(queue->change_at_once({.baud = 115200}).has_value());
  queue->drain([] {});
  EXPECT_EQ(next_look(), milliseconds(1));
  calls->queued = 1000;
  pass(milliseconds(1));
  EXPECT_EQ(next_look(), milliseconds(20));
}

TEST_F(SettingsQueueTest, ALineThatIsHungUpIsLookedAtAllTheSame) {
  calls->queued = 1;
  ASSERT_TRUE(queue->change_at_once({.baud = 0}).has_value());
  queue->drain([] {});
  EXPECT_EQ(next_look(), milliseconds(20));
}

TEST_F(SettingsQueueTest, ADrainOfAnIdleLineIsDoneOnceEachIsCalledOnce) {
  int done = 0;
  queue->drain([&] { ++done; });
  queue->drain([&] { ++done; });
  settle(loop);
  EXPECT_EQ(done, 2);
  EXPECT_EQ(told, "");
}

TEST_F(SettingsQueueTest, ADrainWaitsForWhatIsKeptHereAndBehindAChange) {
  congest();
  bool done = false;
  queue->drain([&done] { done = true; });
  queue->change({.baud = 4800});
  settle(loop);
  EXPECT_FALSE(done);
  (void)all_come();
  settle(loop);
  EXPECT_TRUE(done);
  EXPECT_EQ(told, "4800 drained ");
}

TEST_F(SettingsQueueTest, ADiscardLeavesTheChangesAndTheDrains) {
  congest();
  queue->change({.baud = 4800});
  queue->write(as_bytes("behind"));
  bool done = false;
  queue->drain([&done] { done = true; });
  queue->discard();
  EXPECT_EQ(queue->pending(), 0U);
  EXPECT_FALSE(queue->congested());
  (void)come();
  pass(seconds(1));
  EXPECT_EQ(told, "4800 ");
  EXPECT_TRUE(done);
  EXPECT_EQ(come(), "");
}

TEST_F(SettingsQueueTest, ADrainOfWhatWasDiscardedEndsAMillisecondLater) {
  congest();
  bool done = false;
  queue->drain([&done] { done = true; });
  queue->discard();
  EXPECT_EQ(next_look(), milliseconds(1));
  pass(milliseconds(1));
  EXPECT_TRUE(done);
}

TEST_F(SettingsQueueTest, OnceItIsStoppedNothingIsToldAndNobodyWaits) {
  congest();
  bool drained = false;
  std::optional<LineAnswer> answer;
  queue->drain([&drained] { drained = true; });
  queue->change({.baud = 4800});
  queue->ask({.kind = LineRequest::Kind::get_serial}, [&](const auto& got) { answer = got; });
  queue->stop();
  EXPECT_FALSE(drained) << "not from within the call";
  EXPECT_FALSE(answer.has_value());
  settle(loop);
  EXPECT_TRUE(drained);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->error, EIO);
  pass(seconds(10));
  EXPECT_EQ(told, "");
}

TEST_F(SettingsQueueTest, AChangeThatIsBeingMadeAtTheStopIsNotTold) {
  queue->change({.baud = 4800});
  queue->stop();
  settle(loop);
  EXPECT_EQ(told, "");
}

TEST_F(SettingsQueueTest, ThoseThatDrainCanBeLetGo) {
  calls->queued = 1000;
  int done = 0;
  queue->drain([&done] { ++done; });
  queue->end_drains();
  EXPECT_EQ(done, 0) << "not from within the call";
  settle(loop);
  EXPECT_EQ(done, 1);
  EXPECT_FALSE(loop.next_timer());
}

TEST_F(SettingsQueueTest, OneThatDrainsBehindThoseThatWereLetGoHasItsOwnLastBytes) {
  int done = 0;
  std::string before;
  queue->drain([&done] { ++done; });
  queue->end_drains();  // while the UART sends
  queue->drain([&] { before = calls->journal(); });
  settle(loop);
  EXPECT_EQ(done, 1);
  EXPECT_EQ(before, "(sent)(sent)");
}

}  // namespace
}  // namespace porttape
