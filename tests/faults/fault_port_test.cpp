#include "libport/faults/fault_port.hpp"

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;

// The device, which is told of faults too.
class ToldPort final : public ForwardingPort {
 public:
  ToldPort(MemoryPort::Peer& peer, std::vector<LineFault>& told)
      : ForwardingPort(std::make_unique<MemoryPort>(peer)), told_(&told) {}
  void tell(const LineEvent& event) override {
    if (const auto* fault = std::get_if<LineFault>(&event)) return told_->push_back(*fault);
    ForwardingPort::tell(event);
  }

 private:
  std::vector<LineFault>* told_;
};

class Listener final : public ForwardingPort {
 public:
  Listener(std::unique_ptr<Port> inner, std::vector<LineFault>& faults)
      : ForwardingPort(std::move(inner)), faults_(&faults) {}
  std::vector<std::size_t> arrivals;
  std::function<void()> on_arrival = [] {};

 private:
  void told(const LineEvent& event) override {
    if (const auto* fault = std::get_if<LineFault>(&event)) return faults_->push_back(*fault);
    ForwardingPort::told(event);
  }
  void on_data(ByteView data) override {
    arrivals.push_back(data.size());
    ForwardingPort::on_data(data);
    on_arrival();
  }
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override {
    arrivals.push_back(ends.size());
    ForwardingPort::on_data(data);
    on_arrival();
  }
  std::vector<LineFault>* faults_;
};

class FaultPortTest : public testing::Test {
 protected:
  void make(const std::string& text, bool always_open = false, bool waits = false) {
    Result<FaultPlan> plan = parse_fault_plan(text, {});
    ASSERT_TRUE(plan.has_value());
    auto faults = std::make_unique<FaultPort>(
        PortContext{&loop, book.log()}, std::make_unique<ToldPort>(device, inner_told),
        FaultOptions{.plan = std::move(*plan), .seed = 1, .always_open = always_open, .waits = waits});
    port = std::make_unique<Listener>(std::move(faults), told);
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
  }
  [[nodiscard]] std::string kinds(const std::vector<LineFault>& faults) const {
    std::string kinds;
    for (const LineFault& fault : faults) kinds += fault.kind.raw() + " ";
    return kinds;
  }

  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  MemoryPort::Peer device;
  std::vector<LineFault> inner_told;
  std::vector<LineFault> told;
  PortLog log;
  std::unique_ptr<Listener> port;
};

TEST_F(FaultPortTest, BothWaysHaveTheirFaultsAndNoneIsToldAsALossOfOurs) {
  make("drop:byte=1,dir=r;corrupt:byte=0,dir=w,xor=20");
  device.send("abc");
  port->write(as_bytes("xyz"));
  EXPECT_EQ(log.data, "ac");
  EXPECT_EQ(device.written, "Xyz");
  EXPECT_EQ(log.dropped, 0U);
  EXPECT_EQ(kinds(told), "plan drop corrupt ");
  EXPECT_EQ(kinds(inner_told), "plan drop corrupt ");
  EXPECT_EQ(told[0].seed, 1U);
  EXPECT_EQ(told[1].offset, 1U);
  EXPECT_EQ(told[2].dir, LineDir::w);
  EXPECT_NE(book.text().find("faults made on purpose: drop:byte=1:dir=r;corrupt"), std::string::npos);
  port->close();
  EXPECT_NE(book.text().find("faults made: 1 corrupt, 1 drop"), std::string::npos);
}

TEST_F(FaultPortTest, APlanOfProbabilityZeroLeavesArrivalsAsTheyAre) {
  make("drop:p=0;delay:p=0;hangup:p=0");
  device.send("abc");
  device.arrive("defg", {1, 2, 4});
  EXPECT_EQ(log.data, "abcdefg");
  EXPECT_EQ(port->arrivals, (std::vector<std::size_t>{3, 3})) << "one call each";
  EXPECT_EQ(kinds(told), "plan ");
}

TEST_F(FaultPortTest, ADelayedByteComesLaterAndInOrder) {
  make("delay:byte=1,for=0.002,dir=r");
  const Instant before = loop.now();
  device.send("abc");
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.data == "abc"; }));
  EXPECT_GE(loop.now() - before, milliseconds(2));
}

TEST_F(FaultPortTest, WhatCameBeforeADelayedByteIsNotHeld) {
  make("delay:byte=1,for=1000,dir=r");
  device.send("abc");
  EXPECT_EQ(log.data, "a");
}

TEST_F(FaultPortTest, WhatIsBehindAByteAtWhichTheLineIsOpenedAgainIsNotOfTheNewLine) {
  make("delay:byte=1,for=0.002,dir=r");
  port->on_arrival = [this] {
    port->close();
    port->open();
  };
  device.send("abc");
  let_pass(loop, clock, milliseconds(10));
  EXPECT_EQ(log.data, "a");
}

TEST_F(FaultPortTest, HeldBytesGoWithTheLineUntold) {
  make("delay:p=1,for=1000,dir=r");
  device.send("abc");
  port->close();
  EXPECT_EQ(log.dropped, 0U);
  EXPECT_EQ(log.data, "");
}

TEST_F(FaultPortTest, AHangUpIsALostLineThatCanBeOpenedAgain) {
  make("hangup:byte=2,dir=r");
  device.arrive("abcd", {1, 4});
  EXPECT_EQ(log.data, "ab");
  EXPECT_EQ(log.events, "up lost ");
  EXPECT_TRUE(log.after_reading) << "the driver has what came before";
  EXPECT_EQ(device.calls, "prepare open close ");
  EXPECT_EQ(log.error.code, Errc::device_lost);
  EXPECT_EQ(log.error.message, "memory: unplugged by the fault hangup:byte=2:dir=r");
  EXPECT_EQ(log.dropped, 0U);
  port->close();
  port->open();
  device.send("e");
  EXPECT_EQ(log.data, "abe");
  EXPECT_EQ(kinds(told), "plan hangup plan ");
}

TEST_F(FaultPortTest, AReplugIsAwayAsLongAsItSays) {
  make("replug:byte=0,for=0.005");
  device.send("a");
  port->close();
  device.calls.clear();
  port->open();
  EXPECT_EQ(log.events, "up lost failed ");
  EXPECT_EQ(log.error.code, Errc::device_missing);
  EXPECT_EQ(device.calls, "");
  (void)let_pass(loop, clock, milliseconds(5));
  port->open();
  EXPECT_EQ(log.events, "up lost failed up ");
}

TEST_F(FaultPortTest, AnOpenThatWaitsForAMissingDeviceWaitsForTheEndOfAReplug) {
  make("replug:byte=0,for=0.02", false, true);
  device.send("a");
  EXPECT_EQ(log.events, "up lost ");
  port->close();
  device.calls.clear();
  port->open();
  (void)let_pass(loop, clock, milliseconds(19));
  EXPECT_EQ(log.events, "up lost ") << "neither up nor failed";
  EXPECT_EQ(device.calls, "");
  (void)let_pass(loop, clock, milliseconds(1));
  EXPECT_EQ(log.events, "up lost up ");
  EXPECT_EQ(device.calls, "open ");
}

TEST_F(FaultPortTest, AnOpenThatWaitedAndWasClosedStaysClosed) {
  make("replug:byte=0,for=0.02", false, true);
  device.send("a");
  port->open();
  port->close();
  device.calls.clear();
  (void)let_pass(loop, clock, hours(1));
  EXPECT_EQ(log.events, "up lost ");
  EXPECT_EQ(device.calls, "");
}

TEST_F(FaultPortTest, ALineThatIsKeptOpenIsInterruptedAndBack) {
  make("hangup:byte=1,dir=w", true);
  port->write(as_bytes("abc"));
  EXPECT_EQ(log.events, "up interrupted ");
  device.send("lost");
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "up interrupted resumed "; }));
  device.send("back");
  EXPECT_EQ(log.data, "back");
  EXPECT_EQ(device.written, "a");
}

TEST_F(FaultPortTest, ALineThatIsKeptOpenMeetsItsFaultsWhenItIsBack) {
  make("hangup:byte=0,dir=r;drop:byte=1,dir=w", true);
  device.send("a");
  ASSERT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "up interrupted resumed "; }));
  port->write(as_bytes("xyz"));
  EXPECT_EQ(device.written, "xz");
  EXPECT_EQ(kinds(told), "plan hangup drop ");
}

TEST_F(FaultPortTest, ADriverThatComesMeanwhileWaits) {
  make("replug:byte=0,for=0.02", true);
  device.send("a");
  port->close();
  port->open();
  EXPECT_EQ(log.events, "up interrupted ");
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "up interrupted resumed up "; }));
}

// Found by a seed of the simulation: the second break made the port forget the open.
TEST_F(FaultPortTest, ADriverThatComesMeanwhileWaitsThroughAnotherBreakToo) {
  make("replug:byte=0,for=0.02;replug:at=0.05,for=0.02", true);
  device.send("a");
  port->close();
  port->open();
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "up interrupted resumed up "; }));
  EXPECT_EQ(kinds(told), "plan replug replug plan ");
}

TEST_F(FaultPortTest, APortThatWaitsForItsPeerHangsUp) {
  device.passive = true;
  make("hangup:byte=0");
  device.send("a");
  EXPECT_EQ(device.calls, "prepare open hang_up ");
}

TEST_F(FaultPortTest, TheClockBreaksALineOnWhichNothingComes) {
  make("hangup:at=0.003");
  const Instant before = loop.now();
  ASSERT_NE(port->waiting(), nullptr);
  EXPECT_LE(*port->waiting()->next_due(), before + milliseconds(3));
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "up lost "; }));
  EXPECT_EQ(kinds(told), "plan hangup ");
  port->close();
  port->open();
  EXPECT_EQ(log.events, "up lost up ") << "once";
}

TEST_F(FaultPortTest, OfMoreFaultsThanAnybodyReadsTheNumberIsTold) {
  make("drop:p=1,dir=r");
  device.send(std::string(FaultPort::kMostTold + 5, 'x'));
  EXPECT_EQ(told.size(), 1 + FaultPort::kMostTold);
  port->close();
  ASSERT_EQ(told.back().kind, LineFault::kMore);
  EXPECT_EQ(told.back().count, 5U);
  EXPECT_EQ(inner_told.back(), told.back());
}

TEST_F(FaultPortTest, AsManyFaultsAsAreToldOneByOneHaveNoNumber) {
  make("drop:p=1,dir=r");
  device.send(std::string(FaultPort::kMostTold, 'x'));
  port->close();
  EXPECT_EQ(told.size(), 1 + FaultPort::kMostTold);
  EXPECT_EQ(told.back().kind, "drop");
}

TEST_F(FaultPortTest, OneFaultMoreIsCounted) {
  make("drop:p=1,dir=r");
  device.send(std::string(FaultPort::kMostTold + 1, 'x'));
  port->close();
  ASSERT_EQ(told.back().kind, LineFault::kMore);
  EXPECT_EQ(told.back().count, 1U);
  port->close();
  EXPECT_EQ(told.size(), 2 + FaultPort::kMostTold) << "once";
}

TEST_F(FaultPortTest, WhereNoFaultWasMadeTheCloseTellsNone) {
  make("drop:p=0");
  device.send("abc");
  port->close();
  EXPECT_EQ(book.text().find("faults made:"), std::string::npos);
  EXPECT_EQ(kinds(told), "plan ");
}

TEST_F(FaultPortTest, TheFaultsOfASessionAreToldAtItsEnd) {
  make("drop:byte=0,dir=r");
  device.send("abc");
  port->close();
  const std::size_t at = book.text().find("faults made: 1 drop");
  EXPECT_NE(at, std::string::npos);
  port->open();
  port->close();
  EXPECT_EQ(book.text().rfind("faults made:"), at) << "the next one had none";
}

TEST_F(FaultPortTest, ALineThatIsKeptOpenIsAwayATenthOfASecondAtLeast) {
  make("replug:byte=0,for=0.02", true);
  device.send("a");
  (void)let_pass(loop, clock, milliseconds(100) - Nanos(1));
  EXPECT_EQ(log.events, "up interrupted ");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "up interrupted resumed ");
}

TEST_F(FaultPortTest, ALineThatIsKeptOpenIsAwayAsLongAsIsSaid) {
  make("replug:byte=0,for=3", true);
  device.send("a");
  ASSERT_NE(port->waiting(), nullptr);
  EXPECT_EQ(port->waiting()->next_due(), clock.now() + milliseconds(3000));
  (void)let_pass(loop, clock, milliseconds(3000) - Nanos(1));
  EXPECT_EQ(log.events, "up interrupted ");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "up interrupted resumed ");
}

TEST_F(FaultPortTest, AnOpenShortOfTheEndOfAReplugFailsAndSaysHowLong) {
  make("replug:byte=0,for=2");
  device.send("a");
  port->close();
  (void)let_pass(loop, clock, milliseconds(500));
  port->open();
  EXPECT_EQ(log.error.message, "memory: unplugged by a fault, for 1.500 s more");
  port->close();
  (void)let_pass(loop, clock, milliseconds(1500) - Nanos(1));
  port->open();
  EXPECT_EQ(log.events, "up lost failed failed ");
}

TEST_F(FaultPortTest, TwoBreaksByTheClockComeInTheirOrder) {
  make("hangup:at=2;hangup:at=1");
  (void)let_pass(loop, clock, milliseconds(1000) - Nanos(1));
  EXPECT_EQ(log.events, "up ");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "up lost ");
  EXPECT_EQ(log.error.message, "memory: unplugged by the fault hangup:at=1");
  port->close();
  port->open();
  (void)let_pass(loop, clock, milliseconds(1000) - Nanos(1));
  EXPECT_EQ(log.events, "up lost up ");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "up lost up lost ");
  EXPECT_EQ(kinds(told), "plan hangup plan hangup ");
}

TEST_F(FaultPortTest, AFaultByTheClockStrikesSoLongAfterTheLineCameUp) {
  make("drop:at=0.005,dir=r");
  device.send("ab");
  (void)let_pass(loop, clock, milliseconds(5) - Nanos(1));
  device.send("cd");
  (void)let_pass(loop, clock, Nanos(1));
  device.send("ef");
  device.send("gh");
  EXPECT_EQ(log.data, "abcdfgh");
}

TEST_F(FaultPortTest, ALineThatBreaksAsItComesUpIsLostAndNeverUp) {
  make("hangup:at=0");
  EXPECT_EQ(log.events, "lost ");
  EXPECT_EQ(kinds(told), "plan hangup ");
  port->close();
  port->open();
  EXPECT_EQ(log.events, "lost up ");
}

TEST_F(FaultPortTest, TheClockOfAPlanRunsFromTheFirstTimeTheLineIsUp) {
  make("hangup:at=1");
  port->close();
  (void)let_pass(loop, clock, milliseconds(600));
  port->open();
  (void)let_pass(loop, clock, milliseconds(400) - Nanos(1));
  EXPECT_EQ(log.events, "up up ");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "up up lost ");
}

TEST_F(FaultPortTest, WhatIsWrittenToALineThatIsNotUpMeetsNoFault) {
  make("drop:byte=0,dir=w");
  port->close();
  port->write(as_bytes("a"));
  port->open();
  port->write(as_bytes("xyz"));
  EXPECT_EQ(kinds(told), "plan plan drop ");
  EXPECT_TRUE(device.written.ends_with("yz")) << device.written;
}

}  // namespace
}  // namespace porttape
