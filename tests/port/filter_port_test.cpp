#include "libport/port/filter_port.hpp"

#include <gtest/gtest.h>

#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;

// Holds back each way as long as the test says.
class Delays final : public FilterPort {
 public:
  using FilterPort::FilterPort;
  Nanos in{};
  Nanos out{};

 private:
  void incoming(ByteView arrival) override { deliver(arrival, Loop::now() + in); }
  void outgoing(ByteView data) override { send(data, Loop::now() + out); }
};

class FilterPortTest : public testing::Test {
 protected:
  FilterPortTest() : port({&loop, book.log()}, std::make_unique<MemoryPort>(device)) {
    port.listen(log);
    port.open();
    log.events.clear();
  }
  Loop loop;
  LogBook book;
  MemoryPort::Peer device;
  PortLog log;
  Delays port;
};

TEST_F(FilterPortTest, PassesOnAtOnceWhatIsDue) {
  device.send("a");
  device.arrive("bc", {1, 2});
  port.write(as_bytes("d"));
  EXPECT_EQ(log.data, "abc");
  EXPECT_EQ(device.written, "d");
  EXPECT_FALSE(port.congested());
}

TEST_F(FilterPortTest, KeepsTheOrderOfBytesAndEvents) {
  port.in = milliseconds(2);
  device.send("a");
  port.in = {};
  device.arrive("bc", {1, 2});
  device.interrupt();
  device.resume();
  device.drop(3);
  device.down(LineDown::Reason::closed);
  EXPECT_EQ(log.data + log.events, "");
  EXPECT_EQ(log.dropped, 0U);
  run_until(loop, [this] { return log.events == "interrupted resumed closed "; });
  EXPECT_EQ(log.data, "abc");
  EXPECT_EQ(log.dropped, 3U);
}

TEST_F(FilterPortTest, IsCongestedWhileSomethingWaits) {
  port.out = milliseconds(2);
  port.write(as_bytes("a"));
  port.out = {};
  port.write(as_bytes("b"));
  EXPECT_TRUE(port.congested());
  EXPECT_EQ(device.written, "");
  run_until(loop, [this] { return log.events == "drained "; });
  EXPECT_EQ(device.written, "ab");
  EXPECT_EQ(device.writes, 2);
  EXPECT_FALSE(port.congested());
}

TEST_F(FilterPortTest, WritesNothingToACongestedPort) {
  port.out = milliseconds(1);
  port.write(as_bytes("a"));
  device.congested = true;
  bool later = false;
  Timer after(loop, [&later] { later = true; });
  after.set_after(milliseconds(5));
  run_until(loop, [&later] { return later; });
  EXPECT_EQ(device.written, "");
  device.drain();
  EXPECT_EQ(device.written, "a");
  EXPECT_EQ(log.events, "drained ");
}

TEST_F(FilterPortTest, DeliversNothingWhileNotRead) {
  port.in = milliseconds(1);
  device.send("a");
  port.set_reading(false);
  EXPECT_FALSE(device.reading);
  bool later = false;
  Timer after(loop, [&later] { later = true; });
  after.set_after(milliseconds(5));
  run_until(loop, [&later] { return later; });
  EXPECT_EQ(log.data, "");
  port.read_pending();
  EXPECT_EQ(log.data, "");
  port.set_reading(true);
  EXPECT_TRUE(device.reading);
  run_until(loop, [this] { return log.data == "a"; });
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

}  // namespace
}  // namespace porttape
