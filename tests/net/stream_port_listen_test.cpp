#include "tests/net/stream_port_rig.hpp"

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

TEST_F(ListeningPort, ASecondPeerWaitsUntilTheFirstIsGone) {
  make_listening();
  Socket first = up();
  Socket second = Socket::connect_to(number);
  second.send("second");
  first.send("first");
  until_data("first");
  EXPECT_EQ(log.events, "up ");
  first.close();
  until_data("firstsecond");
  EXPECT_EQ(log.events, "up closed up ");
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
  EXPECT_NE(prepared.error().message.find("in use"), std::string::npos) << prepared.error().message;
}

TEST_F(ListeningPort, AnAddressOfAnotherMachineCannotBeListenedOn) {
  make("tcp-listen:192.0.2.1:2112");
  const Result<void> prepared = port->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
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
