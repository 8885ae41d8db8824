#include "libport/net/stream_listener.hpp"

#include <cerrno>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/descriptor_limit.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {
namespace {

using Inside = StreamListener::Inside;
using std::chrono::milliseconds;
using std::chrono::seconds;
using test::Socket;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class StreamListenerTest : public testing::Test, private StreamListener::Owner {
 protected:
  void make(bool pulled = false) {
    const PortContext context{.loop = &loop, .log = book.log(), .pulled = pulled};
    StreamListener::Owner& owner = *this;
    door.emplace(context, owner, "test", UniqueFd(::dup(socket.fd())));
    door->accept(true);
    settle(loop);
  }
  // A peer that has connected, and been seen by the listener if that looks.
  Socket call(const std::string& text = {}) {
    Socket peer = Socket::connect_to(socket.port());
    if (!text.empty()) peer.send(text);
    settle(loop);
    return peer;
  }
  static std::string address_of(const Socket& peer) { return "127.0.0.1:" + std::to_string(peer.port()); }
  // What the peer's end of the connection has seen: "", "end" or "reset".
  static std::string end_of(Socket& peer) {
    peer.receive();
    return peer.ended;
  }
  int told(const std::string& text) const {
    int count = 0;
    const std::string all = book.text();
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }
  // Who is inside goes.
  void leave() {
    there = Inside::nobody;
    door->left();
    settle(loop);
  }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }

  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  Socket socket = Socket::listening(64);
  Inside there = Inside::nobody;
  PeerState state = PeerState::reading;
  std::vector<std::string> let;  // who was let in
  std::vector<UniqueFd> fds;
  std::vector<std::uint64_t> turned_away;
  std::optional<StreamListener> door;

 private:
  Inside inside() override { return there; }
  void let_in(UniqueFd fd, const std::string& who) override {
    fds.push_back(std::move(fd));
    let.push_back(who);
    there = Inside::there;
  }
  PeerState look_at_peer(int) override { return state; }
  void refused(std::uint64_t bytes) override { turned_away.push_back(bytes); }
};

TEST_F(StreamListenerTest, WhoFindsNobodyIsLetInAtOnce) {
  make();
  const Socket peer = call();
  EXPECT_THAT(let, ElementsAre(address_of(peer)));
}

TEST_F(StreamListenerTest, BeforeItAcceptsNewcomersStayWithTheKernel) {
  make();
  door->accept(false);
  Socket peer = call("early");
  EXPECT_THAT(let, IsEmpty());
  EXPECT_EQ(end_of(peer), "");
  door->accept(true);
  settle(loop);
  EXPECT_THAT(let, ElementsAre(address_of(peer)));
}

TEST_F(StreamListenerTest, ANewcomerIsRefusedTwentyMillisecondsAfterItCame) {
  make();
  const Socket first = call();
  Socket second = call("four");
  pass(milliseconds(20) - Nanos(1));
  EXPECT_EQ(end_of(second), "");
  EXPECT_THAT(turned_away, IsEmpty());
  pass(Nanos(1));
  EXPECT_EQ(end_of(second), "reset");
  EXPECT_THAT(turned_away, ElementsAre(4U));
  EXPECT_THAT(book.text(), HasSubstr("test: " + address_of(second) + " is refused: " + address_of(first) +
                                     " is connected already (see --connections); the 4 bytes that it wrote "
                                     "reach nobody"));
}

TEST_F(StreamListenerTest, EachNewcomerHasItsOwnTwentyMilliseconds) {
  make();
  const Socket first = call();
  Socket second = call();
  pass(milliseconds(15));
  Socket third = call();
  pass(milliseconds(5));
  EXPECT_EQ(end_of(second), "reset");
  EXPECT_EQ(end_of(third), "");
  pass(milliseconds(15) - Nanos(1));
  EXPECT_EQ(end_of(third), "");
  pass(Nanos(1));
  EXPECT_EQ(end_of(third), "reset");
}

TEST_F(StreamListenerTest, OneByteThatWasRefusedIsTold) {
  make();
  const Socket first = call();
  const Socket second = call("x");
  pass(milliseconds(20));
  EXPECT_THAT(turned_away, ElementsAre(1U));
  EXPECT_THAT(book.text(), HasSubstr("; the 1 bytes that it wrote reach nobody"));
}

TEST_F(StreamListenerTest, NothingIsSaidOfBytesWhereNoneWereWritten) {
  make();
  const Socket first = call();
  const Socket second = call();
  pass(milliseconds(20));
  EXPECT_THAT(turned_away, ElementsAre(0U));
  EXPECT_THAT(book.text(), Not(HasSubstr("reach nobody")));
}

TEST_F(StreamListenerTest, SixteenMayWaitAndTheNextIsRefusedAtOnce) {
  make();
  const Socket first = call();
  there = Inside::ended;
  std::vector<Socket> waiting;
  for (std::size_t n = 0; n < StreamListener::kMostWaiting; ++n) {
    waiting.push_back(call());
    waiting.back().end_sending();  // so that the next one may wait for it
  }
  EXPECT_THAT(turned_away, IsEmpty());
  Socket late = call();
  EXPECT_EQ(end_of(late), "reset");
  EXPECT_THAT(turned_away, ElementsAre(0U));
  EXPECT_THAT(book.text(), HasSubstr(address_of(late) + " is refused: too many wait already"));
}

TEST_F(StreamListenerTest, ThatOneWaitsIsToldOnceAndAfterTwentyMilliseconds) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  const std::string waits =
      "test: " + address_of(second) + " waits until the line of " + address_of(first) + " is down";
  pass(milliseconds(20) - Nanos(1));
  EXPECT_EQ(told(waits), 0);
  pass(Nanos(1));
  EXPECT_EQ(told(waits), 1);
  const Socket third = call();  // is looked at 20 ms later, and the second one with it
  pass(seconds(1));
  EXPECT_EQ(told(waits), 1);
}

TEST_F(StreamListenerTest, ANewcomerIsLookedAtByTheOneBeforeIt) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  Socket third = call();
  pass(milliseconds(20));
  EXPECT_EQ(end_of(third), "reset");
  EXPECT_THAT(book.text(),
              HasSubstr(address_of(third) + " is refused: " + address_of(second) + " is connected already"));
}

TEST_F(StreamListenerTest, OneWhoWaitsIsLetInWhenTheOneInsideHasLeft) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  there = Inside::nobody;
  door->left();
  EXPECT_EQ(let.size(), 1U) << "not from within the call";
  settle(loop);
  EXPECT_THAT(let, ElementsAre(address_of(first), address_of(second)));
}

TEST_F(StreamListenerTest, OneAtATimeIsLetIn) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  second.end_sending();
  const Socket third = call();
  leave();
  EXPECT_EQ(let.size(), 2U);
}

TEST_F(StreamListenerTest, ANewcomerDoesNotOvertakeOneThatWaits) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  there = Inside::nobody;
  const Socket third = call();  // before left() is called
  EXPECT_EQ(let.size(), 1U);
  door->left();
  settle(loop);
  EXPECT_EQ(let.back(), address_of(second));
}

TEST_F(StreamListenerTest, WhoWentAwayWhileItWaitedIsToldAndNotLetIn) {
  make();
  const Socket first = call();
  there = Inside::ended;
  Socket dead = call("dead");
  const std::string who = address_of(dead);
  dead.close();
  state = PeerState::gone;
  leave();
  EXPECT_EQ(let.size(), 1U);
  EXPECT_THAT(turned_away, ElementsAre(4U));
  EXPECT_EQ(told("test: " + who + " went away while it waited; the 4 bytes that it wrote reach nobody"), 1);
}

// Whoever judges the line when it goes down knows of it then.
TEST_F(StreamListenerTest, WhoWentAwayIsToldBeforeTheOneInsideHasLeft) {
  make();
  const Socket first = call();
  there = Inside::ended;
  Socket dead = call("dead");
  dead.close();
  state = PeerState::gone;
  there = Inside::nobody;
  door->left();
  EXPECT_THAT(turned_away, ElementsAre(4U));
}

TEST_F(StreamListenerTest, WhoWentAwayIsToldAtTheLookToo) {
  make();
  const Socket first = call();
  there = Inside::ended;
  Socket dead = call("x");
  dead.reset();
  pass(milliseconds(20));
  EXPECT_EQ(turned_away.size(), 1U);
  EXPECT_EQ(told("went away while it waited"), 1);
  leave();
  EXPECT_EQ(let.size(), 1U);
}

TEST_F(StreamListenerTest, OneThatHasEndedItsSendingWaitsOn) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  second.end_sending();
  pass(seconds(1));
  EXPECT_THAT(turned_away, IsEmpty());
  leave();
  EXPECT_THAT(let, ElementsAre(address_of(first), address_of(second)));
}

TEST_F(StreamListenerTest, WhetherTheNextOneWaitsIsKnown) {
  make();
  const Socket first = call();
  there = Inside::ended;
  EXPECT_FALSE(door->next_waits());
  Socket second = call();
  EXPECT_TRUE(door->next_waits());
  second.reset();
  EXPECT_FALSE(door->next_waits()) << "it has gone";
}

TEST_F(StreamListenerTest, RefusalsAreToldOnceASecondWithTheirNumber) {
  make();
  const Socket first = call();
  std::vector<Socket> others;
  for (int n = 0; n < 4; ++n) others.push_back(call());
  pass(milliseconds(20));
  EXPECT_EQ(turned_away.size(), 4U);
  EXPECT_EQ(told("is refused"), 1);
  pass(seconds(1) - Nanos(1));
  EXPECT_EQ(told("more connections were refused"), 0);
  pass(Nanos(1));
  EXPECT_EQ(told("test: 3 more connections were refused"), 1);
  pass(seconds(5));
  EXPECT_EQ(told("more connections were refused"), 1);
}

TEST_F(StreamListenerTest, OneRefusalIsToldInFullAlone) {
  make();
  const Socket first = call();
  const Socket second = call();
  pass(seconds(5));
  EXPECT_EQ(told("is refused"), 1);
  EXPECT_EQ(told("more connections"), 0);
  const Socket third = call();
  pass(milliseconds(20));
  EXPECT_EQ(told("is refused"), 2) << "a second later the next one is told in full";
}

TEST_F(StreamListenerTest, AClosedOneTurnsAwayWhoWaits) {
  make();
  const Socket first = call();
  there = Inside::ended;
  Socket second = call("x");
  door->accept(false);
  EXPECT_EQ(end_of(second), "reset");
  EXPECT_THAT(turned_away, ElementsAre(1U));
  EXPECT_THAT(book.text(), HasSubstr("is refused: the port was closed while it waited"));
}

TEST_F(StreamListenerTest, APulledOneLeavesNewcomersWithTheKernelUntilTheOneInsideHasGone) {
  make(true);
  const Socket first = call();
  EXPECT_FALSE(door->next_waits());
  Socket second = call();
  pass(seconds(1));
  EXPECT_EQ(end_of(second), "");
  EXPECT_EQ(let.size(), 1U);
  EXPECT_TRUE(door->next_waits()) << "at the kernel";
  leave();
  EXPECT_THAT(let, ElementsAre(address_of(first), address_of(second)));
}

TEST_F(StreamListenerTest, APulledOneThatWasClosedLetsInTheNext) {
  make(true);
  const Socket first = call();
  door->accept(false);
  there = Inside::nobody;
  const Socket second = call();
  door->accept(true);
  settle(loop);
  EXPECT_THAT(let, ElementsAre(address_of(first), address_of(second)));
}

TEST_F(StreamListenerTest, OneThatIsNotPulledLooksAtNobodyAtTheKernel) {
  make();
  const Socket first = call();
  const Socket second = Socket::connect_to(socket.port());
  EXPECT_FALSE(door->next_waits()) << "it was not accepted yet";
}

TEST_F(StreamListenerTest, WithoutADescriptorItTriesAgainEachTenthOfASecondAndTellsOnce) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  make();
  const Socket peer = Socket::connect_to(socket.port());
  {
    const test::NoDescriptors none(unsanitized);
    settle(loop);
    EXPECT_EQ(told("a connection cannot be accepted"), 1);
    pass(milliseconds(300));
    EXPECT_EQ(told("a connection cannot be accepted"), 1);
    pass(milliseconds(50));
  }
  pass(milliseconds(50) - Nanos(1));
  EXPECT_THAT(let, IsEmpty());
  pass(Nanos(1));
  EXPECT_THAT(let, ElementsAre(address_of(peer)));
}

TEST_F(StreamListenerTest, AConnectionThatIsGoneByTheAcceptIsNoNews) {
  make();
  for (const int error : {EAGAIN, EINTR, ECONNABORTED}) {
    there = Inside::nobody;
    const Socket peer = Socket::connect_to(socket.port());
    EXPECT_TRUE(test::while_refused({{SYS_accept4, error}}, [&] {
      for (int n = 0; n < 10; ++n) loop.poll_one();
    }));
    EXPECT_EQ(book.text(), "") << error;
    EXPECT_FALSE(loop.next_timer()) << "it looks at the next event";
    settle(loop);
    ASSERT_FALSE(let.empty());
    EXPECT_EQ(let.back(), address_of(peer));
  }
  EXPECT_EQ(let.size(), 3U);
}

TEST_F(StreamListenerTest, WhyAConnectionCannotBeAcceptedIsToldOnceForEachReason) {
  make();
  const Socket peer = Socket::connect_to(socket.port());
  const std::pair<int, std::string> cases[] = {
      {EMFILE, "Too many open files (the limit of this process; see ulimit -n); it waits"},
      {ENFILE, "Too many open files in system; it waits"},
      {ENOBUFS, "No buffer space available; it waits"},
      {ENOMEM, "Cannot allocate memory; it waits"},
      {EPERM, "Operation not permitted; it waits"}};
  for (const auto& [error, why] : cases) {
    EXPECT_TRUE(test::while_refused({{SYS_accept4, error}}, [&] { pass(milliseconds(300)); }));
    EXPECT_EQ(told("test: a connection cannot be accepted: " + why + ", and is tried again"), 1)
        << book.text();
  }
  EXPECT_THAT(let, IsEmpty());
  pass(milliseconds(100));
  EXPECT_THAT(let, ElementsAre(address_of(peer))) << "it has waited";
}

TEST_F(StreamListenerTest, WhatANewcomerWroteIsNotGuessedWhereItCannotBeCounted) {
  make();
  const Socket first = call();
  Socket second = call("four");
  EXPECT_TRUE(test::while_refused({test::refused_ioctl(FIONREAD, EIO)}, [&] { pass(milliseconds(20)); }));
  EXPECT_EQ(end_of(second), "reset");
  EXPECT_EQ(told("bytes that it wrote"), 0);
  EXPECT_THAT(turned_away, ElementsAre(0U));
}

TEST_F(StreamListenerTest, AFailureAfterOneThatWasAcceptedIsToldAgain) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  make();
  for (int n = 1; n <= 2; ++n) {
    there = Inside::nobody;
    const Socket peer = Socket::connect_to(socket.port());
    {
      const test::NoDescriptors none(unsanitized);
      settle(loop);
    }
    EXPECT_EQ(told("a connection cannot be accepted"), n);
    pass(milliseconds(100));
    EXPECT_EQ(let.size(), static_cast<std::size_t>(n));
  }
}

TEST_F(StreamListenerTest, ADestroyedOneLetsNobodyIn) {
  make();
  const Socket first = call();
  there = Inside::ended;
  const Socket second = call();
  there = Inside::nobody;
  door->left();
  door.reset();
  settle(loop);
  EXPECT_EQ(let.size(), 1U);
}

}  // namespace
}  // namespace porttape
