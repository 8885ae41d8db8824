#include "libport/net/stream_line.hpp"

#include <array>
#include <chrono>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "tests/support/port_log.hpp"

namespace porttape {
namespace {

using Answers = PortListener::Answers;
using Reason = LineDown::Reason;
using std::chrono::milliseconds;

class StreamLineTest : public testing::Test, private StreamLine::Owner {
 protected:
  void make(StreamLine::Side side) {
    int ends[2];
    ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends), 0);
    peer.reset(ends[1]);
    StreamLine::Owner& owner = *this;
    line = std::make_unique<StreamLine>(loop, owner, side, "test", UniqueFd(ends[0]));
    line->set_reading(true);
  }
  void send(const std::string& text) {
    ASSERT_EQ(::write(peer.get(), text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  void until_over() {
    run_until(loop, [this] { return over.has_value(); });
    ASSERT_TRUE(over.has_value());
  }

  Loop loop;
  UniqueFd peer;
  PeerState state = PeerState::gone;
  Answers answers = Answers::none;
  bool rest_wanted = false;
  bool another = false;
  std::string data;
  std::uint64_t lost = 0;
  int ended = 0;
  std::optional<LineDown> over;
  std::unique_ptr<StreamLine> line;

 private:
  void line_data(ByteView bytes) override { data += as_text(bytes); }
  void line_drained() override {}
  Answers line_ended() override {
    ++ended;
    return answers;
  }
  void line_over(const LineDown& down) override { over = down; }
  void dropped(std::uint64_t bytes, const char*) override { lost += bytes; }
  bool wants_rest() override { return rest_wanted; }
  PeerState look_at_peer(int) override { return state; }
  bool next_waits() override { return another; }
};

TEST_F(StreamLineTest, APeerThatClosesEndsItBehindItsBytes) {
  make(StreamLine::Side::connected);
  send("last");
  peer.reset();
  until_over();
  EXPECT_EQ(data, "last");
  EXPECT_EQ(over->reason, Reason::closed);
  EXPECT_TRUE(over->after_reading);
  EXPECT_EQ(ended, 0) << "nobody is there to be answered";
}

TEST_F(StreamLineTest, AHalfClosedPeerIsKeptUntilItIsGone) {
  make(StreamLine::Side::accepted);
  state = PeerState::reading;
  answers = Answers::until_hang_up;
  ::shutdown(peer.get(), SHUT_WR);
  run_until(loop, [this] { return ended == 1; });
  EXPECT_FALSE(over.has_value());
  EXPECT_TRUE(line->takes());
  state = PeerState::gone;
  until_over();
  EXPECT_EQ(over->reason, Reason::closed);
}

// Both directions end while a slow peer has not taken all: what is queued goes out first.
TEST_F(StreamLineTest, WhatIsQueuedGoesOutThoughBothSidesHaveEnded) {
  make(StreamLine::Side::accepted);
  state = PeerState::remote;
  answers = Answers::until_hang_up;
  const Bytes much(std::size_t{4} << 20, Byte{7});
  line->write(much);
  line->end_writing();
  ASSERT_TRUE(line->congested());
  ::shutdown(peer.get(), SHUT_WR);
  run_until(loop, [this] { return ended == 1; });
  EXPECT_FALSE(over.has_value());
  std::size_t got = 0;
  std::array<Byte, 65536> buffer{};
  while (!over) {
    for (ssize_t size = 1; size > 0;) {
      size = ::read(peer.get(), buffer.data(), buffer.size());
      if (size > 0) got += static_cast<std::size_t>(size);
    }
    loop.run_one();
  }
  EXPECT_EQ(got, much.size());
  EXPECT_EQ(lost, 0U);
  EXPECT_EQ(over->reason, Reason::closed);
}

TEST_F(StreamLineTest, AQuietPeerOfAnotherMachineMakesRoomForTheNext) {
  make(StreamLine::Side::accepted);
  state = PeerState::remote;
  answers = Answers::until_it_is_quiet;
  another = true;
  const Instant start = loop.now();
  ::shutdown(peer.get(), SHUT_WR);
  until_over();
  EXPECT_GE(loop.now() - start, milliseconds(100));
}

TEST_F(StreamLineTest, ADeadPeerThatIsNotReadIsNoticedWhereNobodyWantsItsRest) {
  make(StreamLine::Side::accepted);
  line->set_reading(false);
  send("rest");
  peer.reset();
  until_over();
  line->close(true);
  EXPECT_EQ(data, "");
  EXPECT_EQ(lost, 4U);
}

TEST_F(StreamLineTest, HungUpItWaitsForThePeersClose) {
  make(StreamLine::Side::connected);
  EXPECT_TRUE(line->hang_up(true));
  send("late");
  peer.reset();
  until_over();
  EXPECT_EQ(over->reason, Reason::hung_up);
  EXPECT_EQ(data, "");
  EXPECT_EQ(lost, 4U);
}

TEST_F(StreamLineTest, HungUpAtOnceItCanBeClosed) {
  make(StreamLine::Side::connected);
  EXPECT_FALSE(line->hang_up(false));
  line->close(false);
  EXPECT_FALSE(over.has_value());
}

}  // namespace
}  // namespace porttape
