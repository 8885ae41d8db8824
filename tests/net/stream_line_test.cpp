#include "libport/net/stream_line.hpp"

#include <array>
#include <cerrno>
#include <chrono>
#include <functional>
#include <linux/sockios.h>
#include <memory>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

using Answers = PortListener::Answers;
using Reason = LineDown::Reason;
using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

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
  // Lets time pass until the line is over; how much.
  Nanos until_over() {
    const Instant begin = clock.now();
    EXPECT_TRUE(let_pass(loop, clock, minutes(1), [this] { return over.has_value(); }));
    return clock.now() - begin;
  }
  // A half-closed line, whose peer was told of as `peer_state`.
  void half_close(PeerState peer_state, Answers wanted) {
    make(StreamLine::Side::accepted);
    state = peer_state;
    answers = wanted;
    ::shutdown(peer.get(), SHUT_WR);
    settle(loop);
    ASSERT_EQ(ended, 1);
  }
  // What the peer can read now.
  std::string got() const {
    std::string all;
    std::array<char, 65536> buffer;
    for (ssize_t size = 0; (size = ::read(peer.get(), buffer.data(), buffer.size())) > 0;)
      all.append(buffer.data(), static_cast<std::size_t>(size));
    return all;
  }
  // Whether the peer's next read is the end.
  bool at_end() const {
    char byte = 0;
    return ::read(peer.get(), &byte, 1) == 0;
  }

  ManualClock clock;
  Loop loop{clock};
  UniqueFd peer;
  PeerState state = PeerState::gone;
  Answers answers = Answers::none;
  bool rest_wanted = false;
  std::optional<std::size_t> elsewhere;
  bool another = false;
  std::string data;
  std::uint64_t lost = 0;
  std::string why;
  int drained = 0;
  std::vector<std::uint64_t> sent;  // the drains that were answered, by their numbers
  int ended = 0;
  std::optional<LineDown> over;
  std::function<void()> on_told;
  std::unique_ptr<StreamLine> line;

 private:
  void line_data(ByteView bytes) override { data += as_text(bytes); }
  void line_drained() override { ++drained; }
  void line_told(const LineEvent& event) override {
    sent.push_back(std::get<line::Sent>(event).number);
    if (on_told) on_told();
  }
  Answers line_ended() override {
    ++ended;
    return answers;
  }
  void line_over(const LineDown& down) override { over = down; }
  void dropped(std::uint64_t bytes, const char* reason) override {
    lost += bytes;
    if (bytes > 0) why = reason;
  }
  bool wants_rest() override { return rest_wanted; }
  std::optional<std::size_t> unread_elsewhere() override { return elsewhere; }
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
  settle(loop);
  EXPECT_EQ(ended, 1);
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
  settle(loop);
  EXPECT_EQ(ended, 1);
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
  ::shutdown(peer.get(), SHUT_WR);
  const Nanos waited = until_over();
  EXPECT_GE(waited, milliseconds(100));
  EXPECT_LE(waited, milliseconds(121)) << "it is looked at every 20 ms";
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

TEST_F(StreamLineTest, AQuietHalfClosedPeerCountsAsGoneTwoSecondsAfterTheLastAnswer) {
  half_close(PeerState::remote, Answers::until_it_is_quiet);
  (void)let_pass(loop, clock, milliseconds(1500));
  line->write(as_bytes("answer"));
  EXPECT_FALSE(over);
  const Nanos waited = until_over();
  EXPECT_GE(waited, seconds(2));
  EXPECT_LE(waited, milliseconds(2021));
  EXPECT_EQ(over->reason, Reason::closed);
  EXPECT_EQ(got(), "answer");
}

TEST_F(StreamLineTest, SomeThatIsWrittenIsAnAnswerToo) {
  half_close(PeerState::remote, Answers::until_it_is_quiet);
  (void)let_pass(loop, clock, milliseconds(1500));
  EXPECT_EQ(line->write_some(as_bytes("answer")), 6U);
  EXPECT_GE(until_over(), seconds(2));
}

TEST_F(StreamLineTest, AHalfClosedPeerOfThisMachineIsNotQuietForTheNext) {
  another = true;
  half_close(PeerState::reading, Answers::until_it_is_quiet);
  EXPECT_GE(until_over(), milliseconds(1999)) << "it is known to read still";
}

TEST_F(StreamLineTest, AHalfClosedPeerWhoseEndWillBeToldIsKept) {
  half_close(PeerState::remote, Answers::until_hang_up);
  EXPECT_FALSE(let_pass(loop, clock, minutes(1), [this] { return over.has_value(); }));
  another = true;
  EXPECT_GE(until_over(), milliseconds(0)) << "but not where another one waits";
}

TEST_F(StreamLineTest, AHalfClosedPeerIsKeptWhileItHasNotTakenAll) {
  half_close(PeerState::remote, Answers::until_it_is_quiet);
  line->write(Bytes(std::size_t{4} << 20, Byte{7}));
  ASSERT_TRUE(line->congested());
  EXPECT_FALSE(let_pass(loop, clock, seconds(30), [this] { return over.has_value(); }));
}

TEST_F(StreamLineTest, AHalfClosedPeerThatClosesIsGoneWhateverIsSaidOfIt) {
  half_close(PeerState::remote, Answers::until_hang_up);
  peer.reset();
  EXPECT_LE(until_over(), milliseconds(20));
  EXPECT_EQ(over->reason, Reason::closed);
}

TEST_F(StreamLineTest, WhereNobodyWantsToAnswerTheEndOfThePeersBytesIsItsClose) {
  make(StreamLine::Side::accepted);
  state = PeerState::reading;
  answers = Answers::none;
  send("last");
  ::shutdown(peer.get(), SHUT_WR);
  EXPECT_EQ(until_over(), Nanos(0));
  EXPECT_EQ(ended, 1);
  EXPECT_EQ(data, "last");
  EXPECT_EQ(over->reason, Reason::closed);
  EXPECT_EQ(over->error.code, Errc::device_lost);
  EXPECT_EQ(over->error.message, "test has closed the connection");
}

TEST_F(StreamLineTest, WhereAllIsSentAndEndedThePeersEndIsTheLines) {
  make(StreamLine::Side::accepted);
  state = PeerState::reading;
  answers = Answers::until_hang_up;
  line->write(as_bytes("all"));
  line->end_writing();
  line->end_writing();
  EXPECT_FALSE(line->takes());
  EXPECT_EQ(got(), "all");
  EXPECT_TRUE(at_end());
  ::shutdown(peer.get(), SHUT_WR);
  EXPECT_EQ(until_over(), Nanos(0));
  EXPECT_EQ(ended, 0) << "there is nothing to be asked";
}

TEST_F(StreamLineTest, TheEndOfWritingComesBehindWhatIsQueued) {
  make(StreamLine::Side::accepted);
  const Bytes much(std::size_t{1} << 20, Byte{7});
  line->write(much);
  line->end_writing();
  ASSERT_TRUE(line->congested());
  std::size_t bytes = 0;
  while (drained == 0) {
    bytes += got().size();
    settle(loop);
  }
  bytes += got().size();
  EXPECT_EQ(bytes, much.size());
  EXPECT_TRUE(at_end());
  EXPECT_EQ(drained, 1);
}

TEST_F(StreamLineTest, ADeadPeersRestIsKeptForTenSecondsWhereItIsWanted) {
  make(StreamLine::Side::accepted);
  rest_wanted = true;
  line->set_reading(false);
  send("rest");
  peer.reset();
  const Nanos waited = until_over();
  EXPECT_GE(waited, seconds(10));
  EXPECT_LE(waited, milliseconds(10'500));
  EXPECT_EQ(over->reason, Reason::closed);
  line->close(true);
  EXPECT_EQ(lost, 4U);
  EXPECT_EQ(why, "they were not read when the line was closed");
}

TEST_F(StreamLineTest, ADeadPeerThatLeftNothingIsSeenWithinAQuarterOfASecond) {
  make(StreamLine::Side::accepted);
  rest_wanted = true;
  line->set_reading(false);
  peer.reset();
  EXPECT_LE(until_over(), milliseconds(250));
}

TEST_F(StreamLineTest, APeerThatIsThereIsKeptUnreadHoweverLong) {
  make(StreamLine::Side::accepted);
  state = PeerState::reading;
  line->set_reading(false);
  send("unread");
  EXPECT_FALSE(let_pass(loop, clock, minutes(1), [this] { return over.has_value(); }));
  EXPECT_EQ(data, "");
  line->set_reading(true);
  settle(loop);
  EXPECT_EQ(data, "unread");
  EXPECT_FALSE(loop.next_timer()) << "the end is seen by reading";
}

TEST_F(StreamLineTest, AConnectionOfOursIsNotLookedAtWhileItIsNotRead) {
  make(StreamLine::Side::connected);
  line->set_reading(false);
  peer.reset();
  settle(loop);
  EXPECT_FALSE(loop.next_timer());
  EXPECT_FALSE(over);
}

TEST_F(StreamLineTest, HungUpItWaitsTwoSecondsForThePeersClose) {
  make(StreamLine::Side::connected);
  line->write(as_bytes("last"));
  EXPECT_TRUE(line->has_peer());
  EXPECT_TRUE(line->hang_up(true));
  EXPECT_FALSE(line->has_peer());
  EXPECT_FALSE(line->takes());
  EXPECT_FALSE(line->hangs_up_when_sent());
  EXPECT_EQ(got(), "last");
  EXPECT_TRUE(at_end());
  EXPECT_EQ(until_over(), seconds(2));
  EXPECT_EQ(over->reason, Reason::hung_up);
}

TEST_F(StreamLineTest, HungUpWithBytesQueuedItSendsThemFirst) {
  make(StreamLine::Side::connected);
  const Bytes much(std::size_t{1} << 20, Byte{7});
  line->write(much);
  ASSERT_TRUE(line->congested());
  EXPECT_TRUE(line->hang_up(true));
  EXPECT_TRUE(line->hangs_up_when_sent());
  std::size_t bytes = 0;
  while (drained == 0) {
    bytes += got().size();
    settle(loop);
  }
  EXPECT_EQ(bytes + got().size(), much.size());
  EXPECT_FALSE(line->hang_up(false)) << "its owner hangs up again once all is sent";
}

TEST_F(StreamLineTest, AHalfClosedLineThatIsHungUpIsOver) {
  half_close(PeerState::reading, Answers::until_hang_up);
  EXPECT_FALSE(line->hang_up(true)) << "the peer's end has come already";
}

TEST_F(StreamLineTest, ABrokenLineOfAPeerThatConnectedIsItsClose) {
  make(StreamLine::Side::accepted);
  line->set_reading(false);
  peer.reset();
  line->write(as_bytes("nobody"));
  settle(loop);
  ASSERT_TRUE(over);
  EXPECT_EQ(over->reason, Reason::closed);
}

TEST_F(StreamLineTest, AWriteToABrokenLineIsTakenAndTold) {
  make(StreamLine::Side::connected);
  line->set_reading(false);
  peer.reset();
  line->write(as_bytes("nobody"));
  EXPECT_FALSE(over) << "not from within the write";
  EXPECT_EQ(lost, 6U);
  EXPECT_EQ(why, "they could not be sent");
  EXPECT_FALSE(line->congested());
  settle(loop);
  ASSERT_TRUE(over);
  EXPECT_EQ(over->reason, Reason::lost);
  EXPECT_EQ(over->error.message, "test: the connection is lost (Broken pipe)");
}

TEST_F(StreamLineTest, UnsentIsWhatWaitsHereAndInTheKernel) {
  make(StreamLine::Side::connected);
  EXPECT_EQ(line->unsent(), 0U);
  const Bytes much(std::size_t{1} << 20, Byte{7});
  line->write(much);
  // A Unix socket's queue counts its overhead as well.
  EXPECT_GE(line->unsent(), much.size());
  const std::size_t dropped = line->drop_unsent();
  EXPECT_GT(dropped, 0U);
  EXPECT_LT(dropped, much.size());
  EXPECT_FALSE(line->congested());
  EXPECT_EQ(got().size(), much.size() - dropped);
  EXPECT_EQ(line->unsent(), 0U);
}

using Numbers = std::vector<std::uint64_t>;

TEST_F(StreamLineTest, ADrainIsAnsweredOnceWhatWasWrittenBeforeItIsSent) {
  make(StreamLine::Side::connected);
  const Bytes much(std::size_t{1} << 20, Byte{7});
  line->write(much);
  EXPECT_TRUE(line->tell(line::Drain{1}));
  EXPECT_TRUE(line->tell(line::Drain{2}));
  line->write(much);
  EXPECT_TRUE(line->tell(line::Drain{3}));
  settle(loop);
  EXPECT_EQ(sent, Numbers{}) << "the peer has read nothing";
  std::size_t bytes = 0;
  while (sent.empty()) {
    bytes += got().size();
    settle(loop);
  }
  EXPECT_EQ(sent, (Numbers{1, 2}));
  EXPECT_TRUE(line->congested()) << "with what was written behind them";
  while (drained == 0) {
    bytes += got().size();
    settle(loop);
  }
  EXPECT_EQ(sent, (Numbers{1, 2, 3}));
  EXPECT_EQ(bytes + got().size(), 2 * much.size());
}

TEST_F(StreamLineTest, ADrainOfNothingAndOtherEventsAreTheCallersToAnswer) {
  make(StreamLine::Side::connected);
  EXPECT_FALSE(line->tell(line::Drain{1}));
  line->write(Bytes(std::size_t{1} << 20, Byte{7}));
  ASSERT_TRUE(line->congested());
  EXPECT_FALSE(line->tell(line::Ask{2, {}})) << "no device is at the other end of a socket";
  EXPECT_FALSE(line->tell(line::Mark{"here"}));
  EXPECT_EQ(sent, Numbers{});
}

TEST_F(StreamLineTest, ADrainOfWhatIsDroppedIsAnsweredOnce) {
  const Bytes much(std::size_t{1} << 20, Byte{7});
  for (const std::string how : {"drop_unsent", "close", "reset"}) {
    sent.clear();
    make(StreamLine::Side::connected);
    line->write(much);
    EXPECT_TRUE(line->tell(line::Drain{1}));
    if (how == "drop_unsent") {
      EXPECT_GT(line->drop_unsent(), 0U);
    } else {
      line->close(how == "close");
    }
    EXPECT_EQ(sent, Numbers{1}) << how;
    (void)got();
    settle(loop);
    EXPECT_EQ(sent, Numbers{1}) << how;
  }
}

TEST_F(StreamLineTest, ADrainOfALineThatBreaksIsAnsweredOnce) {
  make(StreamLine::Side::connected);
  line->write(Bytes(std::size_t{1} << 20, Byte{7}));
  EXPECT_TRUE(line->tell(line::Drain{1}));
  peer.reset();
  until_over();
  EXPECT_EQ(sent, Numbers{1});
  EXPECT_GT(lost, 0U);
  line->close(false);
  EXPECT_EQ(sent, Numbers{1});
}

TEST_F(StreamLineTest, ALineThatIsClosedByTheAnswerToADrainIsNotDrained) {
  make(StreamLine::Side::connected);
  line->write(Bytes(std::size_t{1} << 20, Byte{7}));
  EXPECT_TRUE(line->tell(line::Drain{1}));
  on_told = [this] { line->close(true); };
  while (sent.empty()) {
    (void)got();
    settle(loop);
  }
  EXPECT_EQ(drained, 0);
  (void)got();
  EXPECT_TRUE(at_end());
}

TEST_F(StreamLineTest, WhatIsPendingIsReadAndNothingWhereReadingIsOff) {
  make(StreamLine::Side::accepted);
  line->set_reading(false);
  send("pending");
  line->read_pending();
  EXPECT_EQ(data, "");
  line->set_reading(true);
  line->read_pending();
  EXPECT_EQ(data, "pending");
  line->read_pending();
  EXPECT_EQ(data, "pending");
}

TEST_F(StreamLineTest, CatchingUpComesToThePeersEnd) {
  make(StreamLine::Side::accepted);
  send("left");
  line->catch_up();
  EXPECT_EQ(data, "") << "the peer is there: the loop reads in its turn";
  peer.reset();
  EXPECT_FALSE(line->has_peer());
  line->catch_up();
  EXPECT_EQ(data, "left");
  EXPECT_TRUE(over);
}

TEST_F(StreamLineTest, AnOrderlyCloseLetsThePeerReadAll) {
  make(StreamLine::Side::connected);
  line->write(as_bytes("sent"));
  send("unread");
  line->set_reading(false);
  line->close(true);
  EXPECT_EQ(lost, 6U);
  EXPECT_EQ(got(), "sent");
  EXPECT_TRUE(at_end());
}

TEST_F(StreamLineTest, ACloseThatIsNotOrderlyIsAReset) {
  make(StreamLine::Side::connected);
  send("unread");
  line->close(false);
  EXPECT_EQ(lost, 6U);
  EXPECT_EQ(why, "they were not read when the line broke");
  char byte = 0;
  EXPECT_EQ(::read(peer.get(), &byte, 1), -1);
  EXPECT_EQ(errno, ECONNRESET);
}

TEST_F(StreamLineTest, WhatIsQueuedAtACloseIsTold) {
  make(StreamLine::Side::connected);
  const Bytes much(std::size_t{1} << 20, Byte{7});
  line->write(much);
  line->close(true);
  EXPECT_GT(lost, 0U);
  EXPECT_EQ(why, "they were not sent");
  EXPECT_EQ(got().size(), much.size() - lost);
}

// The peer's end of the line that is hung up with bytes queued.
class HungUpLine : public StreamLineTest {
 protected:
  void hang_up(PeerState peer_state) {
    make(StreamLine::Side::accepted);
    state = peer_state;
    line->write(much);
    ASSERT_TRUE(line->congested());
    ASSERT_TRUE(line->hang_up(true));
  }
  const Bytes much = Bytes(std::size_t{1} << 20, Byte{7});
};

TEST_F(HungUpLine, StillSendsToAPeerThatHasOnlyEndedItsSending) {
  hang_up(PeerState::reading);
  ::shutdown(peer.get(), SHUT_WR);
  settle(loop);
  EXPECT_FALSE(over);
  EXPECT_EQ(ended, 0) << "nobody is asked whether to answer";
  std::size_t bytes = 0;
  while (drained == 0) {
    bytes += got().size();
    settle(loop);
  }
  EXPECT_EQ(bytes + got().size(), much.size());
}

TEST_F(HungUpLine, IsOverWhenThePeerIsGone) {
  hang_up(PeerState::gone);
  ::shutdown(peer.get(), SHUT_WR);
  EXPECT_EQ(until_over(), Nanos(0));
  EXPECT_EQ(over->reason, Reason::hung_up);
}

TEST_F(HungUpLine, IsOverWhenItBreaks) {
  hang_up(PeerState::reading);
  peer.reset();
  EXPECT_EQ(until_over(), Nanos(0));
  EXPECT_EQ(over->reason, Reason::hung_up);
  EXPECT_EQ(over->error.code, Errc::device_lost);
  EXPECT_GT(lost, 0U);
  EXPECT_EQ(why, "they could not be sent");
}

TEST_F(StreamLineTest, ALineThatBreaksWhileItWaitsForThePeersCloseIsHungUp) {
  make(StreamLine::Side::connected);
  line->write(as_bytes("unread"));
  EXPECT_TRUE(line->hang_up(true));
  peer.reset();  // with bytes unread: a reset
  EXPECT_EQ(until_over(), Nanos(0));
  EXPECT_EQ(over->reason, Reason::hung_up);
}

TEST_F(StreamLineTest, APeerWhoseCloseIsStillUnderWayIsSeenToBeGoneAMillisecondLater) {
  half_close(PeerState::reading, Answers::until_hang_up);
  state = PeerState::gone;
  EXPECT_EQ(until_over(), milliseconds(1));
}

TEST_F(StreamLineTest, AHalfClosedPeerIsLookedAtFiftyTimesASecond) {
  half_close(PeerState::reading, Answers::until_hang_up);
  (void)let_pass(loop, clock, milliseconds(970));  // looks: after 1 ms, 21, … 961, 981
  state = PeerState::gone;
  EXPECT_EQ(until_over(), milliseconds(11));
}

TEST_F(StreamLineTest, AnUnreadPeerIsLookedAtFourTimesASecond) {
  make(StreamLine::Side::accepted);
  state = PeerState::reading;
  line->set_reading(false);
  (void)let_pass(loop, clock, milliseconds(300));
  peer.reset();
  EXPECT_EQ(until_over(), milliseconds(200));
}

TEST_F(StreamLineTest, TheTenSecondsForAPeersRestBeginWhenItIsSeenToBeGone) {
  make(StreamLine::Side::accepted);
  state = PeerState::reading;
  rest_wanted = true;
  line->set_reading(false);
  send("rest");
  (void)let_pass(loop, clock, seconds(60));
  peer.reset();
  EXPECT_EQ(until_over(), milliseconds(10'250));
}

TEST_F(StreamLineTest, APeersRestIsKeptAnewAfterSomeOfItWasRead) {
  make(StreamLine::Side::accepted);
  rest_wanted = true;
  line->set_reading(false);
  send("rest");
  peer.reset();
  (void)let_pass(loop, clock, seconds(8));
  line->set_reading(true);
  line->set_reading(false);
  EXPECT_EQ(until_over(), milliseconds(10'250));
}

TEST_F(StreamLineTest, APeersRestIsKeptAsLongAsTheOtherLineTakesBytes) {
  make(StreamLine::Side::accepted);
  rest_wanted = true;
  elsewhere = 1000;
  line->set_reading(false);
  send("rest");
  EXPECT_FALSE(line->left_bytes()) << "it may send more";
  peer.reset();
  EXPECT_TRUE(line->left_bytes());
  for (int n = 0; n < 20; ++n) {
    --*elsewhere;
    (void)let_pass(loop, clock, seconds(9));
    ASSERT_FALSE(over.has_value()) << n;
  }
  (void)let_pass(loop, clock, seconds(11));
  EXPECT_TRUE(over.has_value());
}

TEST_F(StreamLineTest, AnUnreadPeerWhoseRestNobodyWantsAnyMoreIsOverAtTheNextLook) {
  make(StreamLine::Side::accepted);
  rest_wanted = true;
  line->set_reading(false);
  send("rest");
  peer.reset();
  (void)let_pass(loop, clock, seconds(1));
  EXPECT_FALSE(over);
  rest_wanted = false;
  EXPECT_LE(until_over(), milliseconds(250));
}

TEST_F(StreamLineTest, OneByteCountsAsMuchAsMany) {
  make(StreamLine::Side::accepted);
  send("p");
  line->read_pending();
  EXPECT_EQ(data, "p");
  line->set_reading(false);
  send("u");
  line->close(true);
  EXPECT_EQ(lost, 1U);
}

TEST_F(StreamLineTest, OneUnreadByteOfABrokenLineIsTold) {
  make(StreamLine::Side::accepted);
  line->set_reading(false);
  send("u");
  line->close(false);
  EXPECT_EQ(lost, 1U);
}

TEST_F(StreamLineTest, OneUnreadByteOfADeadPeerIsKeptWhereItIsWanted) {
  make(StreamLine::Side::accepted);
  rest_wanted = true;
  line->set_reading(false);
  send("u");
  peer.reset();
  EXPECT_GE(until_over(), seconds(10));
}

TEST_F(StreamLineTest, NothingIsToldAfterTheCloseOfALineThatBroke) {
  make(StreamLine::Side::connected);
  line->set_reading(false);
  peer.reset();
  line->write(as_bytes("nobody"));
  line->close(false);
  settle(loop);
  EXPECT_FALSE(over);
}

TEST_F(StreamLineTest, ADestroyedLineThatBrokeCallsNobody) {
  make(StreamLine::Side::connected);
  line->set_reading(false);
  peer.reset();
  line->write(as_bytes("nobody"));
  line.reset();
  settle(loop);
  EXPECT_FALSE(over);
}

TEST_F(StreamLineTest, ReadingBeginsFromTheLoop) {
  make(StreamLine::Side::accepted);
  line->set_reading(false);
  send("unread");
  line->set_reading(true);
  EXPECT_EQ(data, "") << "not from within the call";
  settle(loop);
  EXPECT_EQ(data, "unread");
}

TEST_F(StreamLineTest, AReceiveThatIsInterruptedOrFindsNothingEndsNothing) {
  make(StreamLine::Side::connected);
  for (const int error : {EAGAIN, EINTR}) {
    data.clear();
    send("ask");
    EXPECT_TRUE(test::while_refused({{SYS_recvfrom, error}}, [&] {
      for (int n = 0; n < 10; ++n) loop.poll_one();
      line->read_pending();
    }));
    EXPECT_EQ(data, "");
    EXPECT_FALSE(over);
    settle(loop);
    EXPECT_EQ(data, "ask");
  }
}

TEST_F(StreamLineTest, WhatBreaksALineIsToldWithItsReason) {
  const std::pair<int, std::string> cases[] = {{ECONNRESET, "Connection reset by peer"},
                                               {ETIMEDOUT, "Connection timed out"},
                                               {EHOSTUNREACH, "No route to host"},
                                               {ENOMEM, "Cannot allocate memory"}};
  for (const StreamLine::Side side : {StreamLine::Side::connected, StreamLine::Side::accepted}) {
    for (const auto& [error, text] : cases) {
      const Error wanted = make_error(Errc::device_lost, "test: the connection is lost (" + text + ")");
      const Reason reason = side == StreamLine::Side::connected ? Reason::lost : Reason::closed;
      over.reset();
      make(side);
      send("x");
      EXPECT_TRUE(test::while_refused({{SYS_recvfrom, error}}, [&] {
        for (int n = 0; n < 10 && !over; ++n) loop.poll_one();
      }));
      ASSERT_TRUE(over) << text;
      EXPECT_EQ(over->error, wanted);
      EXPECT_EQ(over->reason, reason);
      EXPECT_FALSE(over->after_reading);
      line->close(false);

      over.reset();
      lost = 0;
      make(side);
      if (error == ENOMEM) continue;  // of a send no end: it is tried again
      EXPECT_TRUE(test::while_refused({{SYS_sendto, error}}, [&] { line->write(as_bytes("four")); }));
      EXPECT_EQ(lost, 4U);
      EXPECT_EQ(why, "they could not be sent");
      EXPECT_FALSE(over) << "not under the writer's feet";
      settle(loop);
      ASSERT_TRUE(over) << text;
      EXPECT_EQ(over->error, wanted);
      EXPECT_EQ(over->reason, reason);
      line->close(false);
    }
  }
}

TEST_F(StreamLineTest, AFailedSendOfALineThatIsOverEndsItOnce) {
  make(StreamLine::Side::connected);
  EXPECT_TRUE(test::while_refused({{SYS_sendto, EPIPE}}, [&] { line->write(as_bytes("four")); }));
  line->close(false);
  settle(loop);
  EXPECT_FALSE(over) << "its owner has ended it";
}

TEST_F(StreamLineTest, WhatTheKernelHasNoRoomForIsSentLater) {
  make(StreamLine::Side::connected);
  EXPECT_TRUE(test::while_refused({{SYS_sendto, ENOBUFS}}, [&] {
    line->write(as_bytes("four"));
    EXPECT_EQ(line->unsent(), 4U);
    line->end_writing();
  }));
  EXPECT_FALSE(at_end()) << "the end is behind the bytes";
  settle(loop);
  EXPECT_EQ(got(), "four");
  EXPECT_TRUE(at_end());
  EXPECT_EQ(lost, 0U);
}

TEST_F(StreamLineTest, WhatCannotBeCountedIsNotGuessed) {
  make(StreamLine::Side::connected);
  line->set_reading(false);
  send("four");
  line->write(as_bytes("unread"));
  EXPECT_TRUE(
      test::while_refused({test::refused_ioctl(SIOCOUTQ, EIO), test::refused_ioctl(FIONREAD, EIO)}, [&] {
        EXPECT_EQ(line->unsent(), 0U);
        line->close(false);
      }));
  EXPECT_EQ(lost, 0U);
}

TEST_F(StreamLineTest, AnOrderlyCloseEndsThoughNothingCanBeReadAway) {
  for (const int error : {EIO, EAGAIN, 0}) {
    make(StreamLine::Side::connected);
    line->set_reading(false);
    send("four");
    EXPECT_TRUE(test::while_refused({{SYS_recvfrom, error}}, [&] { line->close(true); }));
    EXPECT_EQ(lost, 0U);
  }
}

}  // namespace
}  // namespace porttape
