#include "libport/session/connections.hpp"

#include <deque>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

using Reason = LineDown::Reason;

// A listening port whose connections the test makes.
class Listening final : public Port, private ConnectionSource {
 public:
  Result<void> prepare() override { return {}; }
  void open() override { is_open = true; }
  void close() override { is_open = false; }
  void write(ByteView) override {}
  [[nodiscard]] bool congested() const override { return false; }
  bool end_writing() override { return false; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return 0; }
  void set_reading(bool) override {}
  void hang_up(bool) override {}
  void read_pending() override {}
  [[nodiscard]] PortFacets facets() override { return {.connections = gives ? this : nullptr}; }
  [[nodiscard]] PortTraits traits() const override { return {.passive = true}; }
  [[nodiscard]] std::string name() const override { return "listening"; }

  void ask_for_end(int exit_status) { listener().on_finished(exit_status); }
  void connect(MemoryPort::Peer& peer) { take(std::make_unique<MemoryPort>(peer), "somebody"); }

  bool is_open = false;
  bool gives = true;
  std::size_t most = 256;
  TakeConnection take;

 private:
  void give_each(TakeConnection wanted) override { take = std::move(wanted); }
  [[nodiscard]] std::size_t most_connections() const override { return most; }
};

// Devices that the test plays.
class Devices final : public DeviceGroup {
 public:
  struct Test {
    std::deque<MemoryPort::Peer> peers;  // of each connection
    std::optional<unsigned> ends_after;
    unsigned most = 10;
    unsigned left_over = 0;
    bool must_not_fail = false;
    int status = 0;  // of finish()
    bool finishes = true;
    std::optional<unsigned> came;  // as finish() was told
    int requests = 0;
  };
  explicit Devices(Test& test) : test_(&test) {}

  Result<void> prepare() override { return {}; }
  Result<std::unique_ptr<Port>> port_for(unsigned connection) override {
    if (connection > test_->most) return make_error(Errc::usage, "one too many");
    if (test_->peers.size() < connection) test_->peers.resize(connection);
    return std::unique_ptr<Port>(std::make_unique<MemoryPort>(test_->peers[connection - 1]));
  }
  void request(const RecorderRequest&) override { ++test_->requests; }
  void finish(unsigned came, std::function<void(int)> done) override {
    test_->came = came;
    if (test_->finishes) done(test_->status);
  }
  [[nodiscard]] unsigned left_over(unsigned) const override { return test_->left_over; }
  [[nodiscard]] bool must_not_fail() const override { return test_->must_not_fail; }
  [[nodiscard]] std::optional<unsigned> ends_after() const override { return test_->ends_after; }

 private:
  Test* test_;
};

class ConnectionsTest : public testing::Test {
 protected:
  ConnectionsTest() {
    auto port = std::make_unique<Listening>();
    listening = port.get();
    EndLimits limits;
    limits.completing = std::chrono::milliseconds(20);
    connections = std::make_unique<Connections>(
        PortContext{&loop, book.log()}, std::move(port), std::make_unique<Devices>(devices),
        [this](int status) { end_status = status; }, limits);
  }
  void start() { ASSERT_TRUE(connections->start().has_value()); }
  MemoryPort::Peer& driver() {  // the next one
    drivers.emplace_back();
    listening->connect(drivers.back());
    return drivers.back();
  }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }
  void leave(MemoryPort::Peer& peer) {
    peer.down(Reason::closed);
    run_ready();
  }
  void run_to_end() {
    while (!end_status && loop.run_one()) {
    }
  }

  Loop loop;
  LogBook book;
  std::deque<MemoryPort::Peer> drivers;
  Devices::Test devices;
  Listening* listening = nullptr;
  std::optional<int> end_status;
  std::unique_ptr<Connections> connections;
};

TEST_F(ConnectionsTest, EachHasALineOfItsOwn) {
  start();
  EXPECT_TRUE(listening->is_open);
  driver();
  driver();
  drivers[0].send("one");
  drivers[1].send("two");
  devices.peers[1].send("from two");
  EXPECT_EQ(devices.peers[0].written, "one");
  EXPECT_EQ(devices.peers[1].written, "two");
  EXPECT_EQ(drivers[1].written, "from two");
  EXPECT_EQ(drivers[0].written, "");
  EXPECT_EQ(connections->sessions().size(), 2U);
}

TEST_F(ConnectionsTest, OneThatHasEndedIsFreedAndCounts) {
  start();
  driver();
  driver();
  drivers[0].send("one");
  leave(drivers[0]);
  EXPECT_EQ(connections->sessions().size(), 1U);
  drivers[1].send("two");
  EXPECT_EQ(connections->counters().from_driver_bytes, 6U);
  EXPECT_EQ(connections->counters().opens, 2U);
  EXPECT_FALSE(end_status);
  EXPECT_EQ(driver().calls, "prepare open ");  // the third
  EXPECT_EQ(devices.peers.size(), 3U);
}

TEST_F(ConnectionsTest, OneTooManyIsRefusedAndTold) {
  devices.most = 1;
  start();
  driver();
  EXPECT_EQ(driver().calls, "");
  EXPECT_NE(book.text().find("connection 2 of somebody is refused: one too many"), std::string::npos);
  EXPECT_EQ(connections->sessions().size(), 1U);
  connections->stop();
  run_to_end();
  EXPECT_EQ(end_status, 0);
}

TEST_F(ConnectionsTest, NoMoreAreThereAtOnceThanAreAllowed) {
  start();
  listening->most = 2;
  driver();
  driver();
  EXPECT_EQ(driver().calls, "");
  EXPECT_NE(
      book.text().find(
          "listening: somebody is refused: 2 connections are there, the most that max-connections allows"),
      std::string::npos)
      << book.text();
  EXPECT_EQ(connections->sessions().size(), 2U);
  leave(drivers[0]);
  EXPECT_EQ(driver().calls, "prepare open ") << "there is a place again";
  EXPECT_EQ(devices.peers.size(), 3U) << "the one that was refused is none of the connections";
}

TEST_F(ConnectionsTest, TheWorstStatusCounts) {
  devices.peers.resize(2);
  devices.peers[0].status = exit_status::kDataMismatch;
  devices.peers[1].status = exit_status::kTimingMismatch;
  start();
  leave(driver());
  leave(driver());
  EXPECT_FALSE(end_status);
  connections->stop();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kDataMismatch);
  EXPECT_EQ(devices.came, 2U);
  EXPECT_FALSE(listening->is_open);
}

TEST_F(ConnectionsTest, ADeviceThatIsNotThereCostsItsConnectionAlone) {
  devices.peers.resize(1);
  devices.peers[0].up_at_once = false;
  start();
  driver();
  driver();
  devices.peers[0].port->close();
  devices.peers[0].down(Reason::failed, "no device");
  EXPECT_TRUE(drivers[0].calls.ends_with("hang_up ")) << drivers[0].calls;
  leave(drivers[0]);
  drivers[1].send("two");
  EXPECT_EQ(devices.peers[1].written, "two");
  connections->stop();
  leave(drivers[1]);
  run_to_end();
  EXPECT_EQ(end_status, 0);
}

TEST_F(ConnectionsTest, ADeviceThatCannotBePreparedEndsItsConnection) {
  devices.peers.resize(1);
  devices.peers[0].prepared = make_error(Errc::io, "no disk");
  start();
  EXPECT_EQ(driver().calls, "");
  driver();
  EXPECT_EQ(connections->sessions().size(), 1U);
  connections->stop();
  leave(drivers[1]);
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, ADeviceThatHasGoneIsAnOpenAndALoss) {
  devices.peers.resize(1);
  devices.peers[0].prepared = make_error(Errc::device_missing, "no such device");
  start();
  driver();
  EXPECT_EQ(connections->counters().opens, 1U);
  EXPECT_EQ(connections->counters().device_losses, 1U);
}

TEST_F(ConnectionsTest, AnExceptionEndsItsConnectionAlone) {
  devices.peers.resize(1);
  devices.peers[0].on_open = [this] { loop.post([] { throw std::runtime_error("broken"); }); };
  start();
  driver();
  driver();
  run_ready();
  EXPECT_EQ(connections->sessions().size(), 1U);
  EXPECT_NE(book.text().find("connection 1 is ended: broken"), std::string::npos) << book.text();
  drivers[1].send("two");
  EXPECT_EQ(devices.peers[1].written, "two");
}

TEST_F(ConnectionsTest, StoppingEndsAllAndWaitsForThem) {
  start();
  driver();
  driver();
  connections->stop();
  EXPECT_FALSE(listening->is_open);
  run_ready();
  EXPECT_FALSE(end_status);
  leave(drivers[0]);
  EXPECT_FALSE(end_status);
  leave(drivers[1]);
  run_to_end();
  EXPECT_EQ(end_status, 0);
}

TEST_F(ConnectionsTest, StoppingAgainEndsAtOnce) {
  start();
  driver();
  connections->stop();
  run_ready();
  EXPECT_FALSE(end_status);
  connections->stop();
  connections->stop();
  run_to_end();
  EXPECT_EQ(end_status, 0);
}

TEST_F(ConnectionsTest, WithNobodyThereItEndsToo) {
  devices.status = exit_status::kIncomplete;
  start();
  connections->stop();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kIncomplete);
  EXPECT_EQ(devices.came, 0U);
}

TEST_F(ConnectionsTest, AnEndThatTakesTooLongIsGivenUp) {
  devices.finishes = false;
  start();
  connections->stop();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, AGroupThatIsPlayedOnceEndsWithItsLastConnection) {
  devices.ends_after = 2;
  start();
  leave(driver());
  EXPECT_FALSE(end_status);
  driver();
  driver();  // one more, where the group allows it
  leave(drivers[1]);
  EXPECT_FALSE(end_status);
  leave(drivers[2]);
  run_to_end();
  EXPECT_EQ(end_status, 0);
}

TEST_F(ConnectionsTest, AGroupThatIsPlayedOnceNeedsNoConnectionMoreThanItHas) {
  devices.ends_after = 2;
  start();
  leave(driver());
  leave(driver());
  run_to_end();
  EXPECT_EQ(end_status, 0);
  EXPECT_EQ(devices.came, 2U);
}

TEST_F(ConnectionsTest, AnEndThatTheDriversPortAsksForWhileOneIsUnderWayCompletesNothingTwice) {
  devices.finishes = false;
  start();
  connections->stop();
  run_ready();
  EXPECT_EQ(std::exchange(devices.came, std::nullopt), 0U);
  listening->ask_for_end(exit_status::kRuntime);
  run_ready();
  EXPECT_EQ(devices.came, std::nullopt);
}

TEST_F(ConnectionsTest, ATapeThatMustNotFailEndsAll) {
  devices.must_not_fail = true;
  start();
  driver();
  driver();
  devices.peers[0].finish(exit_status::kRuntime);
  run_ready();
  leave(drivers[0]);
  leave(drivers[1]);
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, TapesThatFailTogetherEndIt) {
  devices.must_not_fail = true;
  start();
  driver();
  driver();
  devices.peers[0].finish(exit_status::kRuntime);
  devices.peers[1].finish(exit_status::kRuntime);
  run_ready();
  leave(drivers[0]);
  leave(drivers[1]);
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, ARequestReachesTheGroupAndEach) {
  start();
  driver();
  driver();
  EXPECT_TRUE(connections->request(RecorderRequest::next_tape()));
  EXPECT_EQ(devices.requests, 1);
  EXPECT_TRUE(devices.peers[0].calls.ends_with("next_tape ")) << devices.peers[0].calls;
  EXPECT_TRUE(devices.peers[1].calls.ends_with("next_tape ")) << devices.peers[1].calls;
}

TEST_F(ConnectionsTest, ARequestIsGoodWhereOneTakesItAndElseSaysWhyNot) {
  start();
  driver();
  driver();
  const Error why = make_error(Errc::usage, "a test wants it");
  devices.peers[1].requested = why;
  EXPECT_TRUE(connections->request(RecorderRequest::next_tape())) << "the first took it";
  devices.peers[0].requested = why;
  EXPECT_EQ(connections->request(RecorderRequest::next_tape()).error(), why);
  EXPECT_EQ(connections->request(PlaybackRequest{}).error(),
            make_error(Errc::usage, "memory is no tape that is replayed"));
}

TEST_F(ConnectionsTest, TheLogTellsWhoseConnectionItSpeaksOf) {
  start();
  driver();
  EXPECT_NE(book.text().find("listening: connection 1 is from somebody"), std::string::npos) << book.text();
  driver();
  EXPECT_NE(book.text().find("listening: connection 2 is from somebody"), std::string::npos) << book.text();
  devices.peers[1].interrupt();
  EXPECT_NE(book.text().find("[test c2]"), std::string::npos) << book.text();
  EXPECT_EQ(book.text().find("[test c3]"), std::string::npos) << book.text();
}

TEST_F(ConnectionsTest, AGroupThatIsPlayedOnceEndsWhereItsLastConnectionCannotBegin) {
  devices.ends_after = 1;
  devices.peers.resize(1);
  devices.peers[0].prepared = make_error(Errc::io, "a test wants it");
  start();
  driver();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, AGroupThatIsPlayedOnceEndsWhereItsLastConnectionThrows) {
  devices.ends_after = 1;
  devices.peers.resize(1);
  devices.peers[0].on_open = [this] { loop.post([] { throw std::runtime_error("broken"); }); };
  start();
  driver();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, TheDriversPortEndsItWithItsStatus) {
  start();
  listening->ask_for_end(exit_status::kRuntime);
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTest, ASecondStopGivesUpEachConnectionAtOnce) {
  start();
  driver().congested = true;
  driver().congested = true;
  connections->stop();
  for (const MemoryPort::Peer& each : drivers) EXPECT_EQ(each.calls.find("close"), std::string::npos);
  connections->stop();
  for (const MemoryPort::Peer& each : drivers) EXPECT_NE(each.calls.find("close"), std::string::npos);
}

TEST_F(ConnectionsTest, APortWithoutConnectionsIsAUsageError) {
  listening->gives = false;
  const Result<void> started = connections->start();
  ASSERT_FALSE(started.has_value());
  EXPECT_EQ(started.error().code, Errc::usage);
}

TEST_F(ConnectionsTest, WhereNobodyIsThereARequestIsRefused) {
  start();
  const Result<void> asked = connections->request(RecorderRequest::next_tape());
  ASSERT_FALSE(asked.has_value());
  EXPECT_EQ(asked.error().message, "listening: no connection is there");
  EXPECT_EQ(devices.requests, 1) << "the group may have something to do";
}

// How long an end takes whose tapes are never completed, by a clock that is moved.
class ConnectionsTimeTest : public testing::Test {
 protected:
  void begin(unsigned left_over) {
    devices.finishes = false;
    devices.left_over = left_over;
    connections = std::make_unique<Connections>(
        PortContext{&loop, book.log()}, std::make_unique<Listening>(), std::make_unique<Devices>(devices),
        [this](int status) { end_status = status; },
        EndLimits{.completing = std::chrono::seconds(10), .at_once = std::chrono::milliseconds(500)});
    ASSERT_TRUE(connections->start().has_value());
    connections->stop();
  }
  bool ends_within(Nanos time) {
    return let_pass(loop, clock, time, [this] { return end_status.has_value(); });
  }

  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  Devices::Test devices;
  std::optional<int> end_status;
  std::unique_ptr<Connections> connections;
};

TEST_F(ConnectionsTimeTest, AnEndHasTheTimeOfOneTapeWhereNoneIsLeft) {
  begin(0);
  EXPECT_FALSE(ends_within(std::chrono::milliseconds(9'999)));
  EXPECT_TRUE(ends_within(std::chrono::milliseconds(1)));
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(ConnectionsTimeTest, AnEndHasThatTimeForEachTapeThatIsLeft) {
  begin(3);
  EXPECT_FALSE(ends_within(std::chrono::milliseconds(29'999)));
  EXPECT_TRUE(ends_within(std::chrono::milliseconds(1)));
}

TEST_F(ConnectionsTimeTest, AfterASecondStopItHasHalfASecond) {
  begin(3);
  EXPECT_FALSE(ends_within(std::chrono::seconds(1)));
  connections->stop();
  EXPECT_FALSE(ends_within(std::chrono::milliseconds(499)));
  EXPECT_TRUE(ends_within(std::chrono::milliseconds(1)));
}

}  // namespace
}  // namespace porttape
