#include "libport/port/filter_port.hpp"

#include <memory>
#include <optional>
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

// Holds back, or drops, each way as the test says.
class Delays final : public FilterPort {
 public:
  using FilterPort::FilterPort;
  Nanos in{};
  Nanos out{};
  bool loses = false;
  bool closes_behind_first = false;

 private:
  void incoming(ByteView arrival) override {
    if (loses) return drop(arrival.size(), "a test wants it");
    deliver(arrival, now() + in);
    if (closes_behind_first) close();
  }
  void outgoing(ByteView data) override {
    if (loses) return drop(data.size(), "a test wants it");
    send(data, now() + out);
  }
};

class FilterPortTest : public testing::Test {
 protected:
  FilterPortTest() : port({&loop, book.log()}, std::make_unique<MemoryPort>(device)) {
    port.listen(log);
    log.answers_to = &port;
    port.open();
    log.events.clear();
  }
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  MemoryPort::Peer device;
  PortLog log;
  Delays port;
};

TEST_F(FilterPortTest, AReplaysEndWaitsForItsLastBytesAndAFailedEndForNothing) {
  port.in = milliseconds(2);
  device.send("answer");
  device.finish(exit_status::kPass);
  EXPECT_EQ(log.events, "");
  device.finish(exit_status::kRuntime);
  EXPECT_EQ(log.events, "finished1 ");
  EXPECT_EQ(log.data, "");
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "finished1 finished0 "; }));
  EXPECT_EQ(log.data, "answer");
}

TEST_F(FilterPortTest, PassesOnAtOnceWhatIsDue) {
  device.send("a");
  device.arrive("bc", {1, 2});
  port.write(as_bytes("d"));
  EXPECT_EQ(log.data, "abc");
  EXPECT_EQ(device.written, "d");
  EXPECT_FALSE(port.congested());
}

TEST_F(FilterPortTest, ArrivalsThatCameTogetherStayTogether) {
  device.arrive("abc", {1, 3});
  EXPECT_EQ(log.arrivals, 2U);
  EXPECT_EQ(log.calls, 1);
  port.in = hours(1);
  device.arrive("de", {1, 2});
  port.read_pending();
  EXPECT_EQ(log.data, "abcde");
}

TEST_F(FilterPortTest, PassesOnWhenItIsTime) {
  port.in = port.out = milliseconds(1);
  device.send("a");
  port.write(as_bytes("b"));
  EXPECT_TRUE(
      let_pass(loop, clock, hours(1), [this] { return log.data == "a" && log.events == "drained "; }));
  EXPECT_EQ(device.written, "b");
}

TEST_F(FilterPortTest, KeepsTheOrderOfBytesAndEvents) {
  port.in = hours(1);
  device.send("a");
  port.in = {};
  device.arrive("bc", {1, 2});
  device.interrupt();
  device.resume();
  device.drop(3);
  device.down(LineDown::Reason::closed);
  EXPECT_EQ(log.data + log.events, "");
  EXPECT_EQ(log.dropped, 3U) << "told at once";
  port.read_pending();
  EXPECT_EQ(log.events, "interrupted resumed closed ");
  EXPECT_EQ(log.data, "abc");
}

TEST_F(FilterPortTest, FlushesAndSettingsKeepTheirPlace) {
  port.in = port.out = hours(1);
  device.send("a");
  device.flush(FlushQueue::in);
  device.set({});
  port.write(as_bytes("b"));
  port.tell(line::Flush{FlushQueue::in});
  device.calls.clear();
  EXPECT_EQ(log.events + device.calls, "");
  port.read_pending();
  EXPECT_EQ(log.data, "a");
  EXPECT_EQ(log.events, "flush_in settings ");
  port.end_writing();
  EXPECT_EQ(device.written, "b");
  EXPECT_EQ(device.calls, "peer_flushed end_writing ");
}

TEST_F(FilterPortTest, IsCongestedWhileSomethingWaits) {
  port.out = hours(1);
  port.write(as_bytes("a"));
  port.out = {};
  port.write(as_bytes("b"));
  EXPECT_TRUE(port.congested());
  EXPECT_EQ(device.written, "");
  port.end_writing();
  EXPECT_EQ(log.events, "drained ");
  EXPECT_EQ(device.written, "ab");
  EXPECT_EQ(device.writes, 2);
  EXPECT_FALSE(port.congested());
}

TEST_F(FilterPortTest, WritesNothingToACongestedPort) {
  device.congested = true;
  port.out = milliseconds(1);
  port.write(as_bytes("a"));
  (void)let_pass(loop, clock, milliseconds(5));
  EXPECT_EQ(device.written, "");
  device.drain();
  EXPECT_EQ(device.written, "a");
  EXPECT_EQ(log.events, "drained ");
}

TEST_F(FilterPortTest, DeliversNothingWhileNotRead) {
  port.set_reading(false);
  EXPECT_FALSE(device.reading);
  port.in = milliseconds(1);
  device.send("a");
  (void)let_pass(loop, clock, milliseconds(5));
  EXPECT_EQ(log.data, "");
  port.read_pending();
  EXPECT_EQ(log.data, "");
  port.set_reading(true);
  EXPECT_TRUE(device.reading);
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.data == "a"; }));
}

TEST_F(FilterPortTest, HoldsBackNoMoreThanItsShare) {
  port.in = hours(1);
  device.send(std::string(FilterPort::kMostWaiting - 1, 'a'));
  EXPECT_TRUE(device.reading);
  device.send("b");
  EXPECT_FALSE(device.reading);
  port.read_pending();
  EXPECT_EQ(log.data.size(), FilterPort::kMostWaiting);
  EXPECT_TRUE(device.reading);
}

TEST_F(FilterPortTest, AnEndWaitsForNoDelay) {
  port.in = port.out = hours(1);
  device.send("answer");
  port.write(as_bytes("ask"));
  EXPECT_TRUE(port.end_writing());
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(device.end(), PortListener::Answers::until_it_is_quiet);
  EXPECT_EQ(log.data, "answer");
  port.write(as_bytes("!"));
  port.hang_up(false);
  EXPECT_EQ(device.written, "ask!");
}

TEST_F(FilterPortTest, WhatWaitsAtACloseIsTold) {
  port.in = port.out = hours(1);
  device.send("answer");
  device.down(LineDown::Reason::closed);
  port.write(as_bytes("ask"));
  port.close();
  EXPECT_EQ(log.dropped, 9U);
  EXPECT_FALSE(port.congested());
  port.read_pending();
  EXPECT_EQ(log.data + log.events, "") << "nothing of it comes later";
}

TEST_F(FilterPortTest, NewSettingsComeAfterTheWritesBeforeThem) {
  device.settings = LineSettings{.baud = 9600};
  port.out = hours(1);
  port.write(as_bytes("at 9600"));
  EXPECT_TRUE(port.apply({.baud = 300}).has_value());
  EXPECT_EQ(device.written, "at 9600");
  EXPECT_EQ(device.settings, LineSettings{.baud = 300});
}

TEST_F(FilterPortTest, DropsAreToldWhateverIsHeld) {
  port.in = hours(1);
  device.send("abc");
  port.loses = true;
  device.send("de");
  port.write(as_bytes("f"));
  EXPECT_EQ(log.dropped, 3U);
  port.close();
  EXPECT_EQ(log.dropped, 6U);
}

TEST_F(FilterPortTest, WhatWaitsAtTheEndIsTold) {
  port.in = hours(1);
  port.close();
  device.send("abc");
  EXPECT_EQ(log.dropped, 0U);
  port.finish();
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(log.status, 0);
}

TEST_F(FilterPortTest, WritesThatWaitAtTheEndAreToldToo) {
  port.out = hours(1);
  port.write(as_bytes("ask"));
  port.finish();
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(log.why, "they were held back at the end");
  EXPECT_EQ(device.written, "");
}

TEST_F(FilterPortTest, WhereNobodyKnowsWhatThePeerHasUnreadWhatIsHeldDoesNotTell) {
  port.in = hours(1);
  device.send("abc");
  EXPECT_EQ(device.unread_by_driver(), std::nullopt);
  log.peer_unread = 2;
  EXPECT_EQ(device.unread_by_driver(), 5U);
}

TEST_F(FilterPortTest, HeldWritesDoNotReachTheNextPeer) {
  device.passive = true;
  port.out = hours(1);
  port.write(as_bytes("a"));
  device.down(LineDown::Reason::closed);
  EXPECT_EQ(log.dropped, 1U);
  EXPECT_FALSE(port.congested());
  device.up();
  port.out = {};
  port.write(as_bytes("b"));
  EXPECT_EQ(device.written, "b");
}

TEST_F(FilterPortTest, WritesToALineThatIsDownUnseenAreDropped) {
  device.passive = true;
  port.in = hours(1);
  device.send("last");
  device.down(LineDown::Reason::closed);
  device.up();
  port.write(as_bytes("for the first peer"));
  EXPECT_EQ(device.written, "");
  EXPECT_EQ(log.dropped, 18U);
  port.read_pending();
  EXPECT_EQ(log.events, "closed up ");
  port.write(as_bytes("b"));
  EXPECT_EQ(device.written, "b");
}

TEST_F(FilterPortTest, WritesWaitWhileTheLineIsInterrupted) {
  device.calls.clear();
  port.out = hours(1);
  port.write(as_bytes("a"));
  device.interrupt();
  port.out = {};
  port.write(as_bytes("b"));
  port.end_writing();
  EXPECT_EQ(device.written, "");
  EXPECT_TRUE(port.congested());
  EXPECT_EQ(device.calls, "");
  device.resume();
  EXPECT_EQ(log.events, "interrupted resumed drained ");
  EXPECT_EQ(device.written, "ab");
  EXPECT_EQ(device.calls, "end_writing ");
}

// What a port that is congested holds is the inner port's before its end is.
TEST_F(FilterPortTest, AnEndWaitsForACongestedPort) {
  device.calls.clear();
  device.congested = true;
  port.out = hours(1);
  port.write(as_bytes("ask"));
  EXPECT_TRUE(port.end_writing());
  EXPECT_EQ(device.written + device.calls, "");
  EXPECT_TRUE(port.congested());
  device.drain();
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(device.calls, "end_writing ");
}

TEST_F(FilterPortTest, AnEndIsOnlyPromisedOfALineThatHasIt) {
  device.congested = true;
  device.half_closes = false;
  port.write(as_bytes("ask"));
  EXPECT_FALSE(port.end_writing());
}

TEST_F(FilterPortTest, AHangUpAfterReadingWaitsForACongestedPort) {
  device.calls.clear();
  device.congested = true;
  port.write(as_bytes("last"));
  port.hang_up(true);
  EXPECT_EQ(device.written + device.calls, "");
  device.drain();
  EXPECT_EQ(device.written, "last");
  EXPECT_EQ(device.calls, "hang_up_after_reading ");
}

TEST_F(FilterPortTest, AHangUpAtOnceDropsWhatACongestedPortDoesNotTake) {
  device.calls.clear();
  device.congested = true;
  port.write(as_bytes("last"));
  port.hang_up(true);
  port.hang_up(false);
  EXPECT_EQ(device.calls, "hang_up ");
  EXPECT_EQ(log.dropped, 4U);
  device.drain();
  EXPECT_EQ(device.written, "");
  EXPECT_EQ(device.calls, "hang_up ") << "the other one is over";
}

TEST_F(FilterPortTest, AnEndThatWaitsGoesWithItsLine) {
  device.calls.clear();
  device.congested = true;
  port.write(as_bytes("last"));
  port.end_writing();
  device.down(LineDown::Reason::lost);
  EXPECT_EQ(log.dropped, 4U);
  EXPECT_EQ(device.calls, "");
}

TEST_F(FilterPortTest, SettingsWaitForACongestedPort) {
  device.calls.clear();
  device.settings = LineSettings{.baud = 9600};
  device.congested = true;
  port.write(as_bytes("at 9600"));
  EXPECT_TRUE(port.apply({.baud = 300}).has_value());
  EXPECT_TRUE(port.apply({.baud = 600}).has_value());
  EXPECT_EQ(port.settings(), LineSettings{.baud = 600}) << "what follows is compared with these";
  EXPECT_EQ(device.settings, LineSettings{.baud = 9600});
  device.drain();
  EXPECT_EQ(device.written, "at 9600");
  EXPECT_EQ(device.calls, "apply apply ");
  EXPECT_EQ(device.settings, LineSettings{.baud = 600});
}

TEST_F(FilterPortTest, SettingsThatWaitedAndAreRefusedAreTold) {
  device.settings = LineSettings{.baud = 9600};
  device.takes_settings = false;
  device.congested = true;
  port.write(as_bytes("at 9600"));
  EXPECT_TRUE(port.apply({.baud = 300}).has_value());
  EXPECT_EQ(log.events, "");
  device.drain();
  EXPECT_EQ(log.events, "settings drained ");
  EXPECT_EQ(port.settings(), LineSettings{.baud = 9600});
}

TEST_F(FilterPortTest, WritesGoOnWhenTheLineIsResumed) {
  device.interrupt();
  port.write(as_bytes("a"));
  EXPECT_EQ(device.written, "");
  device.resume();
  EXPECT_EQ(device.written, "a");
  EXPECT_EQ(log.events, "interrupted resumed drained ");
}

TEST_F(FilterPortTest, ALineThatBreaksUnreadIsToldAndTakesItsBytes) {
  port.in = hours(1);
  device.send("abc");
  port.set_reading(false);
  device.down(LineDown::Reason::lost);
  EXPECT_EQ(log.events, "lost ");
  EXPECT_EQ(log.data, "");
  EXPECT_EQ(log.dropped, 3U);
}

TEST_F(FilterPortTest, ALineThatIsInterruptedUnreadIsTold) {
  port.in = hours(1);
  device.send("abc");
  device.interrupt();
  port.set_reading(false);
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return log.events == "interrupted "; }));
  EXPECT_EQ(log.dropped, 3U);
}

TEST_F(FilterPortTest, ALineThatWasClosedWaitsToBeRead) {
  port.in = hours(1);
  device.send("abc");
  port.set_reading(false);
  device.down(LineDown::Reason::closed);
  EXPECT_EQ(log.events + log.data, "");
  const std::optional<Instant> limit = port.waiting()->next_due();
  ASSERT_TRUE(limit.has_value());
  EXPECT_LE(*limit, loop.now() + std::chrono::seconds(10));
  port.set_reading(true);
  port.read_pending();
  EXPECT_EQ(log.events, "closed ");
  EXPECT_EQ(log.data, "abc");
}

TEST_F(FilterPortTest, AnEndedPeerIsToldBehindItsBytes) {
  port.in = hours(1);
  device.send("a");
  port.set_reading(false);
  EXPECT_EQ(device.end(), PortListener::Answers::until_it_is_quiet);
  EXPECT_EQ(log.events, "");
  port.set_reading(true);
  port.read_pending();
  EXPECT_EQ(log.events, "ended ");
  EXPECT_EQ(log.data, "a");
}

TEST_F(FilterPortTest, ReadPendingReadsAllThoughFull) {
  port.in = hours(1);
  std::string rest(1000, 'x');
  device.send(std::string(FilterPort::kMostWaiting, 'a'));
  device.pending = [&] {
    if (device.reading) device.send(std::exchange(rest, {}));
  };
  port.read_pending();
  EXPECT_EQ(log.data.size(), FilterPort::kMostWaiting + 1000);
  EXPECT_EQ(log.data.back(), 'x');
  EXPECT_FALSE(port.waiting()->next_due().has_value());
}

TEST_F(FilterPortTest, TheRestIsWantedOfALineThatIsStoppedForWhatIsHeld) {
  port.in = hours(1);
  device.send(std::string(FilterPort::kMostWaiting, 'a'));
  EXPECT_FALSE(device.reading);
  EXPECT_TRUE(device.wants_rest());
  port.set_reading(false);
  EXPECT_FALSE(device.wants_rest());
  log.wanted = true;
  EXPECT_TRUE(device.wants_rest());
}

TEST_F(FilterPortTest, HeldBytesAreForWaitingCallsWhateverTheInnerPortHas) {
  ASSERT_NE(port.waiting(), nullptr);
  WaitingCalls& calls = *port.waiting();
  port.in = port.out = hours(1);
  EXPECT_EQ(calls.write_some(as_bytes("abc")), 3U);
  EXPECT_EQ(calls.write_some(as_bytes("d")), 0U);
  EXPECT_EQ(calls.unsent(), 3U);
  EXPECT_EQ(calls.awaits(), "");
  device.send("x");
  EXPECT_TRUE(calls.next_due().has_value());
  EXPECT_TRUE(calls.discard());
  EXPECT_FALSE(calls.next_due().has_value());
  EXPECT_EQ(calls.unsent(), 0U);
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(FilterPortTest, ADeviceThatWasNotReadForWhatIsHeldIsReadAgainOnceThatIsDiscarded) {
  port.in = hours(1);
  for (int n = 0; device.reading && n < 100'000; ++n) device.send(std::string(4096, 'x'));
  ASSERT_FALSE(device.reading) << "as much is held as is held at most";
  EXPECT_TRUE(port.waiting()->discard());
  EXPECT_TRUE(device.reading);
  EXPECT_EQ(log.data, "");
}

TEST_F(FilterPortTest, AWaitingCallWaitsForTheFirstOfBothWays) {
  for (const auto& [in, out] :
       {std::pair(milliseconds(5), milliseconds(9)), std::pair(milliseconds(9), milliseconds(5)),
        std::pair(milliseconds(5), milliseconds(5))}) {
    port.in = in;
    port.out = out;
    device.send("x");
    EXPECT_EQ(port.waiting()->next_due(), loop.now() + in) << "one way alone";
    port.write(as_bytes("y"));
    EXPECT_EQ(port.waiting()->next_due(), loop.now() + milliseconds(5));
    EXPECT_TRUE(port.waiting()->discard());
    port.write(as_bytes("y"));
    EXPECT_EQ(port.waiting()->next_due(), loop.now() + out) << "the other way alone";
    EXPECT_TRUE(port.waiting()->discard());
  }
}

TEST_F(FilterPortTest, ALineThatIsClosedByWhatWasHeldIsNotToldOfItsEnd) {
  port.in = hours(1);
  device.send("bye");
  device.wait_until_sent([this] { port.close(); });
  EXPECT_EQ(device.end(), PortListener::Answers::none);
  EXPECT_EQ(log.data, "bye");
  EXPECT_EQ(log.events, "drain ");
}

// One that delivers from within set_reading(), as a tape does, and may refuse a discard().
class Eager final : public Port, private WaitingCalls {
 public:
  Result<void> prepare() override { return {}; }
  void open() override { listener().on_up(); }
  void close() override {}
  void write(ByteView) override {}
  [[nodiscard]] bool congested() const override { return false; }
  bool end_writing() override { return true; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return {}; }
  void set_reading(bool on) override {
    if (on && !rest.empty()) say(std::exchange(rest, {}));
  }
  void hang_up(bool) override {}
  void read_pending() override {}
  [[nodiscard]] PortFacets facets() override { return {.waiting = this}; }
  [[nodiscard]] PortTraits traits() const override { return {}; }
  [[nodiscard]] std::string name() const override { return "eager"; }

  void say(const std::string& text) { listener().on_data(as_bytes(text)); }
  void say(const std::string& text, std::vector<std::size_t> ends) {
    listener().on_arrivals(as_bytes(text), ends);
  }
  std::string rest;
  bool discards = true;

 private:
  std::size_t write_some(ByteView data) override { return data.size(); }
  [[nodiscard]] std::size_t unsent() override { return 0; }
  bool discard() override {
    if (discards) rest.clear();
    return discards;
  }
};

class FilterOfEager : public testing::Test {
 protected:
  FilterOfEager() : device(new Eager), port({&loop, book.log()}, std::unique_ptr<Port>(device)) {
    port.listen(log);
    port.open();
  }
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  PortLog log;
  Eager* device;
  Delays port;
};

TEST_F(FilterOfEager, ARefusedDiscardLeavesWhatIsHeld) {
  device->discards = false;
  port.in = hours(1);
  device->say("a");
  EXPECT_FALSE(port.waiting()->discard());
  port.read_pending();
  EXPECT_EQ(log.data, "a");
}

TEST_F(FilterOfEager, ADiscardTakesTheInnerPortsRestToo) {
  port.in = hours(1);
  device->say(std::string(FilterPort::kMostWaiting, 'a'));
  device->rest = "old";
  EXPECT_TRUE(port.waiting()->discard());
  port.read_pending();
  EXPECT_EQ(log.data, "");
}

TEST_F(FilterOfEager, WhatComesWhenItIsReadAgainOvertakesNothing) {
  port.in = hours(1);
  device->say(std::string(FilterPort::kMostWaiting, 'a'));
  device->rest = "b";
  port.in = {};
  port.read_pending();
  EXPECT_EQ(log.data.size(), FilterPort::kMostWaiting + 1);
  EXPECT_EQ(log.data.front(), 'a');
  EXPECT_EQ(log.data.back(), 'b');
}

TEST_F(FilterOfEager, AfterACloseMidwayTheOtherArrivalsAreDropped) {
  port.closes_behind_first = true;
  device->say("abc", {1, 2, 3});
  EXPECT_EQ(log.data, "a");
  EXPECT_EQ(log.dropped, 2U);
}

TEST_F(FilterPortTest, SignalsAndDrainsKeepTheirPlaceEitherWay) {
  port.in = port.out = hours(1);
  device.calls.clear();
  int sent = 0;
  device.send("a");
  device.signal({LineSignal::Name::cts, true});
  device.wait_until_sent([&sent] { ++sent; });
  port.write(as_bytes("b"));
  port.tell(LineSignal{LineSignal::Name::rts, false});
  log.drain(port, [&sent] { ++sent; });
  EXPECT_EQ(log.events + device.calls, "");
  port.read_pending();
  EXPECT_EQ(log.events, "cts+ drain ");
  EXPECT_EQ(log.signals_after, std::vector<std::size_t>{1});
  EXPECT_EQ(sent, 1);
  port.end_writing();
  EXPECT_EQ(device.calls, "rts_off drain end_writing ");
  EXPECT_EQ(sent, 1) << "the inner port is not done";
  device.drains.at(0)();
  EXPECT_EQ(sent, 2);
}

TEST_F(FilterPortTest, SignalsAndDrainsWithNothingHeldGoOnAtOnce) {
  device.calls.clear();
  port.tell(LineSignal{LineSignal::Name::dtr, true});
  log.drain(port, [] {});
  device.signal({LineSignal::Name::ri, true});
  EXPECT_EQ(device.calls, "dtr_on drain ");
  EXPECT_EQ(log.events, "ri+ ");
}

TEST_F(FilterPortTest, QuestionsKeepTheirPlaceEitherWay) {
  port.in = port.out = hours(1);
  device.calls.clear();
  int answers = 0;
  const TakeAnswer take = [&answers](const std::optional<LineAnswer>&) { ++answers; };
  device.send("a");
  device.ask(take);
  port.write(as_bytes("b"));
  log.ask(port, {}, take);
  EXPECT_EQ(answers, 0);
  EXPECT_EQ(device.calls, "");
  port.read_pending();
  EXPECT_EQ(answers, 1);
  port.end_writing();
  EXPECT_EQ(device.calls, "ask end_writing ");
  device.questions.at(0)(LineAnswer{});
  EXPECT_EQ(answers, 2);
}

TEST_F(FilterPortTest, ADrainThatIsHeldWhenTheLineGoesDownReachesTheInnerPortOnce) {
  port.out = hours(1);
  port.write(as_bytes("a"));
  log.drain(port, [] {});
  device.calls.clear();
  device.down(LineDown::Reason::lost);
  EXPECT_EQ(device.calls, "drain ");
  port.close();
  EXPECT_EQ(device.drains.size(), 1U);
}

TEST_F(FilterPortTest, ADrainThatIsHeldAtACloseReachesTheInnerPortOnce) {
  port.out = hours(1);
  port.write(as_bytes("a"));
  log.drain(port, [] {});
  device.calls.clear();
  port.close();
  EXPECT_EQ(device.calls, "close drain ");
  EXPECT_EQ(device.drains.size(), 1U);
}

TEST_F(FilterPortTest, ALineThatWasClosedWaitsTenSecondsToBeRead) {
  port.in = hours(1);
  device.send("abc");
  port.set_reading(false);
  device.down(LineDown::Reason::closed);
  (void)let_pass(loop, clock, std::chrono::seconds(10) - Nanos(1));
  EXPECT_EQ(log.events, "");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "closed ");
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(log.why, "nobody read them before the line broke");
}

TEST_F(FilterPortTest, AReplaysEndWaitsTenSecondsForAReader) {
  port.in = hours(1);
  device.send("abc");
  port.set_reading(false);
  device.finish(exit_status::kPass);
  (void)let_pass(loop, clock, std::chrono::seconds(10) - Nanos(1));
  EXPECT_EQ(log.events, "");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "finished0 ");
}

TEST_F(FilterPortTest, WhereNothingIsHeldAnEndTellsNoLoss) {
  port.close();
  port.finish();
  EXPECT_EQ(log.why, "");
  port.in = hours(1);
  device.send("abc");
  port.close();
  EXPECT_EQ(log.why, "they were held back when the line was closed");
}

TEST_F(FilterPortTest, AWriteBehindALineThatWentDownSaysSo) {
  port.in = hours(1);
  device.send("abc");
  port.set_reading(false);
  device.down(LineDown::Reason::closed);
  port.write(as_bytes("ask"));
  EXPECT_EQ(log.why, "the line had gone down");
  EXPECT_EQ(device.written, "");
}

TEST_F(FilterPortTest, APortThatIsReadAgainIsNotReadWhileItsShareIsHeld) {
  port.in = hours(1);
  device.send(std::string(FilterPort::kMostWaiting, 'a'));
  port.set_reading(false);
  port.set_reading(true);
  EXPECT_FALSE(device.reading);
}

TEST_F(FilterPortTest, BehindReadPendingWhatComesIsHeldAgain) {
  port.in = hours(1);
  port.read_pending();
  device.send("abc");
  EXPECT_EQ(log.data, "");
}

}  // namespace
}  // namespace porttape
