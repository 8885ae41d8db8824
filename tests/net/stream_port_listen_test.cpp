#include <algorithm>
#include <fcntl.h>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/net/stream_port_rig.hpp"
#include "tests/support/descriptor_limit.hpp"

namespace porttape {
namespace {

class ListeningPort : public StreamPortRig {};

TEST_F(ListeningPort, ListensAndComesUpWithEachPeer) {
  make_listening();
  EXPECT_TRUE(port->passive());
  Socket first = up();
  first.send("one");
  until_data("one");
  first.close();
  until("up closed ");
  Socket second = up();
  port->write(as_bytes("two"));
  until_got(second, "two");
}

TEST_F(ListeningPort, ASecondPeerIsRefusedWhileTheFirstIsThere) {
  make_listening();
  Socket first = up();
  Socket second = Socket::connect_to(number);
  const std::string who = "127.0.0.1:" + std::to_string(second.port());
  second.send("second");
  until_got(second, "", "reset");
  first.send("first");
  until_data("first");
  EXPECT_EQ(log.events, "up ");
  const std::string told = who + " is refused: 127.0.0.1:" + std::to_string(first.port()) + " is connected";
  EXPECT_NE(book.text().find(told), std::string::npos) << book.text();
  EXPECT_NE(book.text().find("the 6 bytes that it wrote reach nobody"), std::string::npos) << book.text();
  EXPECT_EQ(log.refused, std::vector<std::uint64_t>{6});
}

TEST_F(ListeningPort, ManyThatAreRefusedAreToldTogether) {
  make_listening();
  const Socket first = up();
  for (int n = 0; n < 40; ++n) {
    Socket next = Socket::connect_to(number);
    until_got(next, "", "reset");
  }
  EXPECT_EQ(log.refused, std::vector<std::uint64_t>(40, 0));
  const std::string text = book.text();
  EXPECT_LT(std::count(text.begin(), text.end(), '\n'), 20) << text;
}

TEST_F(ListeningPort, ASecondPeerWaitsForOneThatHasEnded) {
  make_listening();
  Socket first = up();
  first.end_sending();
  until("up ended ");
  Socket second = Socket::connect_to(number);
  second.send("second");
  run_until(loop, [&] { return book.text().find("waits until") != std::string::npos; });
  EXPECT_EQ(log.data, "");
  Socket third = Socket::connect_to(number);  // while the second is there
  until_got(third, "", "reset");
  port->write(as_bytes("answer"));
  until_got(first, "answer");
  first.close();
  until_data("second");
  EXPECT_EQ(log.events, "up ended closed up ");
}

TEST_F(ListeningPort, WhatADeadPeerWroteWhileItWaitedReachesNobody) {
  make_listening();
  Socket first = up();
  first.end_sending();
  until("up ended ");
  Socket dead = Socket::connect_to(number);
  dead.send("dead");
  dead.close();
  Socket alive = Socket::connect_to(number);
  alive.send("alive");
  first.close();
  until_data("alive");
  EXPECT_EQ(log.events, "up ended closed up ");
  EXPECT_NE(book.text().find("went away while it waited; the 4 bytes"), std::string::npos) << book.text();
}

TEST_F(ListeningPort, ASecondPeerWaitsForBytesOfTheFirstThatAreNotRead) {
  log.wanted = true;
  make_listening();
  port->set_reading(false);
  Socket first = up();
  first.send("first");
  first.close();
  Socket second = Socket::connect_to(number);
  second.send("second");
  run_until(loop, [&] { return book.text().find("waits until") != std::string::npos; });
  port->set_reading(true);
  until_data("firstsecond");
  EXPECT_EQ(log.events, "up closed up ");
}

TEST_F(ListeningPort, AReconnectIsServedHoweverFastItComes) {
  make_listening();
  for (int n = 0; n < 30; ++n) {
    Socket peer = Socket::connect_to(number);
    peer.send(".");
    until_data(std::string(static_cast<std::size_t>(n + 1), '.'));
    n % 2 == 0 ? peer.close() : peer.reset();  // the port sees it and the next one at once
  }
  EXPECT_EQ(book.text().find("refused"), std::string::npos) << book.text();
}

TEST_F(ListeningPort, OneThatComesAndGoesWhileThePortIsFreeIsServed) {
  make_listening();
  for (const std::string text : {"one", "two", "three"}) {
    Socket peer = Socket::connect_to(number);
    peer.send(text);
  }
  until_data("onetwothree");
}

TEST_F(ListeningPort, WhoWaitsIsTurnedAwayWhenThePortCloses) {
  make_listening();
  Socket first = up();
  first.end_sending();
  until("up ended ");
  Socket second = Socket::connect_to(number);
  run_until(loop, [&] { return book.text().find("waits until") != std::string::npos; });
  port->close();
  until_got(second, "", "reset");
}

TEST_F(ListeningPort, AConnectionCanBeGivenAwayAsAPortOfItsOwn) {
  make("tcp-listen:0");
  std::vector<std::unique_ptr<Port>> given;
  std::vector<std::string> names;
  port->connections()->give_each([&](std::unique_ptr<Port> connection, const std::string& who) {
    given.push_back(std::move(connection));
    names.push_back(who);
  });
  number = test::prepare_any(*port);
  port->open();
  Socket one = Socket::connect_to(number);
  Socket two = Socket::connect_to(number);
  run_until(loop, [&] { return given.size() == 2; });
  EXPECT_EQ(names[0], "127.0.0.1:" + std::to_string(one.port()));
  PortLog log_one;
  given[0]->listen(log_one);
  EXPECT_FALSE(given[0]->passive());
  EXPECT_EQ(given[0]->connections(), nullptr);
  ASSERT_TRUE(given[0]->prepare().has_value());
  given[0]->open();
  EXPECT_EQ(log_one.events, "up ");
  one.send("to one");
  run_until(loop, [&] { return log_one.data == "to one"; });
  given[0]->write(as_bytes("from one"));
  until_got(one, "from one");
  given.pop_back();  // unwanted
  until_got(two, "", "reset");
  one.close();
  run_until(loop, [&] { return log_one.events == "up closed "; });
  EXPECT_EQ(log.events, "");
}

TEST_F(ListeningPort, OneOnAllAddressesTakesThoseOfIPv4Too) {
  const SocketAddress six = *numeric_address("::1", 0);
  const UniqueFd probe(::socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!probe || ::bind(probe.get(), six.get(), six.size) != 0) GTEST_SKIP() << "no IPv6 here";
  make("tcp-listen:[::]:0");
  number = test::prepare_any(*port);
  port->open();
  Socket by_four = up();
  by_four.close();
  until("up closed ");
  Socket by_six = Socket::connect_to(*numeric_address("::1", number));
  until("up closed up ");
}

TEST_F(ListeningPort, TenPeersInARowAreServed) {
  make_listening();
  for (int n = 0; n < 10; ++n) {
    Socket peer = up();
    peer.send(".");
    until_data(std::string(static_cast<std::size_t>(n + 1), '.'));
    peer.close();
    run_until(loop, [&] { return log.events.ends_with("closed "); });
  }
}

TEST_F(ListeningPort, APeerThatResetsIsGone) {
  make_listening();
  up().reset();
  until("up closed ");
}

TEST_F(ListeningPort, AHalfClosedPeerStillGetsItsAnswer) {
  make_listening();
  Socket peer = up();
  peer.send("question");
  peer.end_sending();
  until("up ended ");
  EXPECT_EQ(log.data, "question");
  port->write(as_bytes("answer"));
  until_got(peer, "answer");
  port->hang_up(true);
  until("up ended hung_up ");
  until_got(peer, "answer", "end");
}

TEST_F(ListeningPort, AHalfClosedPeerThatThenClosesIsNoticed) {
  make_listening();
  Socket peer = up();
  peer.end_sending();
  until("up ended ");
  peer.close();
  until("up ended closed ");
}

TEST_F(ListeningPort, AHalfClosedPeerIsNotKeptWhereNobodyWantsIt) {
  make_listening();
  log.answers = PortListener::Answers::none;
  Socket peer = up();
  peer.end_sending();
  until("up ended closed ");
  until_got(peer, "", "end");
}

TEST_F(ListeningPort, AQuietHalfClosedPeerIsClosedInTheEnd) {
  make_listening();
  Socket peer = up();
  peer.end_sending();
  until("up ended closed ");
  until_got(peer, "", "end");
}

TEST_F(ListeningPort, AHalfClosedPeerIsKeptWhereItsEndWillBeTold) {
  make_listening();
  log.answers = PortListener::Answers::until_hang_up;
  Socket peer = up();
  peer.end_sending();
  until("up ended ");
  bool waited = false;
  Timer longer_than_quiet(loop, [&] { waited = true; });
  longer_than_quiet.set_after(std::chrono::milliseconds(2300));
  run_until(loop, [&] { return waited; });
  EXPECT_EQ(log.events, "up ended ");
  port->write(as_bytes("late answer"));
  port->hang_up(true);
  until_got(peer, "late answer", "end");
}

TEST_F(ListeningPort, APeerThatDiesUnreadIsNoticed) {
  make_listening();
  port->set_reading(false);
  Socket first = up();
  first.send("unread");
  first.close();
  until("up closed ");
  EXPECT_EQ(log.dropped, 6U);
  up().reset();
  until("up closed up closed ");
}

TEST_F(ListeningPort, WhatADeadPeerLeftIsReadWhereItIsWanted) {
  make_listening();
  log.wanted = true;
  port->set_reading(false);
  Socket peer = up();
  peer.send("last words");
  peer.close();
  bool waited = false;
  Timer looked_at(loop, [&] { waited = true; });
  looked_at.set_after(std::chrono::milliseconds(600));
  run_until(loop, [&] { return waited; });
  EXPECT_EQ(log.events, "up ");
  port->set_reading(true);
  until("up closed ");
  EXPECT_EQ(log.data, "last words");
}

TEST_F(ListeningPort, ReadonlyAndWriteonlyHold) {
  make_listening(",readonly");
  Socket peer = up();
  port->write(as_bytes("no"));
  peer.send("yes");
  until_data("yes");
  EXPECT_EQ(log.dropped, 2U);
  log = {};
  make_listening(",writeonly");
  Socket other = up();
  other.send("no");
  run_until(loop, [&] { return log.dropped == 2; });
  port->write(as_bytes("yes"));
  until_got(other, "yes");
  EXPECT_EQ(log.data, "");
}

TEST_F(ListeningPort, HangingUpLetsThePeerReadFirst) {
  make_listening();
  Socket peer = up();
  const std::string much(std::size_t{16} << 20, 'x');
  port->write(as_bytes(much));
  EXPECT_TRUE(port->congested());
  port->hang_up(true);
  until_got(peer, much, "end");
  peer.close();
  until("up hung_up ");
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(ListeningPort, HangingUpAtOnceResets) {
  make_listening();
  Socket peer = up();
  port->hang_up(false);
  until("up hung_up ");
  until_got(peer, "", "reset");
}

TEST_F(ListeningPort, BytesAfterAHangUpAreCountedAndDropped) {
  make_listening();
  Socket peer = up();
  port->hang_up(true);
  peer.send("late");
  peer.close();
  until("up hung_up ");
  EXPECT_EQ(log.data, "");
  EXPECT_EQ(log.dropped, 4U);
}

TEST_F(ListeningPort, ASlowPeerCongestsAndDrainsAndTheOtherWayStaysFree) {
  make_listening();
  Socket peer = up();
  const std::string much(std::size_t{16} << 20, 'x');
  port->write(as_bytes(much));
  EXPECT_TRUE(port->congested());
  peer.send("meanwhile");
  until_data("meanwhile");
  until_got(peer, much);
  until("up drained ");
}

TEST_F(ListeningPort, IsDrainedOnceTheKernelHasItAll) {
  make_listening();
  int done = 0;
  const auto count = [&done] { ++done; };
  log.drain(*port, count);
  EXPECT_EQ(done, 1) << "there is no line";
  Socket peer = up();
  log.drain(*port, count);
  EXPECT_EQ(done, 2) << "nothing was written";
  const std::string much(std::size_t{16} << 20, 'x');
  port->write(as_bytes(much));
  log.drain(*port, count);
  run_ready();
  EXPECT_EQ(done, 2);
  until_got(peer, much);
  run_until(loop, [&] { return done == 3; });
}

TEST_F(ListeningPort, IsDrainedThoughMoreWasWrittenBehindIt) {
  make_listening();
  Socket peer = up();
  const std::string much(std::size_t{16} << 20, 'x');
  port->write(as_bytes(much));
  bool done = false;
  log.drain(*port, [&] {
    done = true;
    EXPECT_TRUE(port->congested());
  });
  port->write(as_bytes(much));
  until_got(peer, much + much);
  EXPECT_TRUE(done);
}

TEST_F(ListeningPort, IsDrainedWhenTheLineIsOver) {
  make_listening();
  int done = 0;
  const auto count = [&done] { ++done; };
  const std::string much(std::size_t{16} << 20, 'x');
  for (int line = 1; line <= 2; ++line) {
    Socket peer = up();
    port->write(as_bytes(much));
    log.drain(*port, count);
    line == 1 ? peer.close() : port->close();
    run_until(loop, [&] { return done == line; });
  }
  run_ready();
  EXPECT_EQ(done, 2);
}

TEST_F(ListeningPort, IsDrainedOnceWhenItIsHungUpAndNotFromWithinThat) {
  make_listening();
  int done = 0;
  const std::string much(std::size_t{16} << 20, 'x');
  for (int line = 1; line <= 2; ++line) {
    log.events.clear();
    Socket peer = up();
    port->write(as_bytes(much));
    log.drain(*port, [&done] { ++done; });
    port->hang_up(line == 1);
    EXPECT_EQ(done, line - 1);
    if (line == 1) {
      until_got(peer, much, "end");
      peer.close();
    }
    until("up hung_up ");
    run_ready();
    EXPECT_EQ(done, line);
  }
}

TEST_F(ListeningPort, ADestroyedPortAnswersNoDrain) {
  make_listening();
  const Socket peer = up();
  port->write(as_bytes(std::string(std::size_t{16} << 20, 'x')));
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  port->close();
  port.reset();
  run_ready();
  EXPECT_FALSE(done);
}

TEST_F(ListeningPort, IsDrainedWhenWhatWaitsIsDiscarded) {
  make_listening();
  const Socket peer = up();
  port->write(as_bytes(std::string(std::size_t{16} << 20, 'x')));
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  EXPECT_TRUE(port->waiting()->discard());
  EXPECT_FALSE(port->congested());
  run_ready();
  EXPECT_TRUE(done);
  EXPECT_EQ(log.dropped, 0U) << "it was asked for";
  EXPECT_EQ(log.events, "up ");
}

TEST_F(ListeningPort, NotReadingIsBackpressureToThePeer) {
  make_listening();
  Socket peer = up();
  port->set_reading(false);
  peer.send("later");
  run_ready();
  EXPECT_EQ(log.data, "");
  port->set_reading(true);
  until_data("later");
}

TEST_F(ListeningPort, UnsentBytesAreCountedAtClose) {
  make_listening();
  Socket peer = up();
  port->write(as_bytes(std::string(std::size_t{16} << 20, 'x')));
  port->close();
  EXPECT_GT(log.dropped, 0U);
  EXPECT_EQ(log.events, "up ");
}

TEST_F(ListeningPort, AWriteToAPeerThatIsGoneTakesTheLineDown) {
  make_listening();
  Socket peer = up();
  port->set_reading(false);  // only the write can notice
  peer.reset();
  port->write(as_bytes("x"));
  EXPECT_EQ(log.events, "up ");
  until("up closed ");
  EXPECT_EQ(log.dropped, 1U);
}

TEST_F(ListeningPort, APortInUseIsAUsageError) {
  make("tcp-listen:" + std::to_string(server.port()));
  const Result<void> prepared = port->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
  EXPECT_EQ(prepared.error().message,
            "cannot listen on 127.0.0.1:" + std::to_string(server.port()) +
                ": Address already in use; another program listens there; choose another port");
}

TEST_F(ListeningPort, AnAddressOfAnotherMachineCannotBeListenedOn) {
  make("tcp-listen:192.0.2.1:2112");
  const Result<void> prepared = port->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
  EXPECT_EQ(prepared.error().message,
            "cannot listen on 192.0.2.1:2112: Cannot assign requested address; this machine has no such "
            "address");
}

TEST_F(ListeningPort, WithoutADescriptorAConnectionWaitsAndIsTriedAgain) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  make_listening();
  const Socket peer = Socket::connect_to(number);
  const std::string told =
      "a connection cannot be accepted: Too many open files (the limit of this process; see ulimit -n); it "
      "waits, and is tried again";
  {
    const test::NoDescriptors none(unsanitized);
    run_until(loop, [&] { return book.text().find(told) != std::string::npos; });
  }
  EXPECT_NE(book.text().find(told), std::string::npos) << book.text();
  EXPECT_EQ(log.events, "");
  until("up ");
  EXPECT_EQ(book.text().find(told), book.text().rfind(told)) << "once";
}

TEST_F(ListeningPort, PortZeroIsPrinted) {
  make_listening();
  EXPECT_NE(number, 0);
  const Socket peer = up();
}

TEST_F(ListeningPort, ListensOnIpv6) {
  make("tcp-listen:[::1]:0");
  testing::internal::CaptureStdout();
  const Result<void> prepared = port->prepare();
  const std::string printed = testing::internal::GetCapturedStdout();
  if (!prepared) GTEST_SKIP() << "no IPv6 here: " << prepared.error().message;
  ASSERT_TRUE(printed.starts_with("[::1]:")) << printed;
  port->open();
  const Socket peer =
      Socket::connect_to(*numeric_address("::1", static_cast<std::uint16_t>(std::stoi(printed.substr(6)))));
  until("up ");
}

}  // namespace
}  // namespace porttape
