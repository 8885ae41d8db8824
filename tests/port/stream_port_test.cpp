#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "libport/port/port_factory.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {
namespace {

using test::Socket;

// What both kinds of stream sockets do; shown with TCP on the loopback interface.
class StreamPortTest : public testing::Test {
 protected:
  void make(const std::string& spec) {
    const Result<PortOptions> options = parse_port(spec);
    ASSERT_TRUE(options.has_value()) << options.error().message;
    Result<std::unique_ptr<Port>> made = make_port({&loop, book.log()}, *options, "test");
    ASSERT_TRUE(made.has_value());
    port = std::move(*made);
    port->listen(log);
  }
  void make_listening(const std::string& more = {}) {
    number = test::free_port();
    make("tcp-listen:" + std::to_string(number) + more);
    ASSERT_TRUE(port->prepare().has_value());
    port->open();
  }
  void make_connecting(const std::string& more = {}) {
    make("tcp:127.0.0.1:" + std::to_string(server.port()) + more);
    ASSERT_TRUE(port->prepare().has_value());
  }
  void until(const std::string& events) {
    run_until(loop, [&] { return log.events == events || log.events.size() > events.size() + 40; });
    EXPECT_EQ(log.events, events);
  }
  void until_data(const std::string& data) {
    run_until(loop, [&] { return log.data == data; });
  }
  // Turns the loop until the peer has seen that.
  void until_got(Socket& peer, const std::string& text, const std::string& ended = {}) {
    Timer tick(loop, [] {});
    run_until(loop, [&] {
      tick.set_after(std::chrono::milliseconds(1));
      peer.receive();
      return peer.got == text && peer.ended == ended;
    });
  }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }
  Socket up() {  // a client of the listening port
    Socket peer = Socket::connect_to(number);
    run_until(loop, [&] { return log.events.ends_with("up "); });
    return peer;
  }
  Socket accepted() {  // the server's end of the connecting port's connection
    run_until(loop, [&] { return log.events.ends_with("up ") && server.readable(); });
    return server.accept();
  }

  Loop loop;
  LogBook book;
  PortLog log;
  Socket server = Socket::listening();
  std::uint16_t number = 0;
  std::unique_ptr<Port> port;
};

TEST_F(StreamPortTest, ConnectsAndPassesBytesBothWays) {
  make_connecting();
  port->open();
  EXPECT_EQ(log.events, "");
  Socket peer = accepted();
  port->write(as_bytes("ask"));
  until_got(peer, "ask");
  peer.send("answer");
  until_data("answer");
}

TEST_F(StreamPortTest, IsNotConnectedBeforeOpen) {
  make_connecting();
  run_ready();
  EXPECT_FALSE(server.readable());
}

TEST_F(StreamPortTest, ConnectsAgainAfterClose) {
  make_connecting();
  port->open();
  Socket first = accepted();
  port->close();
  until_got(first, "", "end");
  port->open();
  Socket second = accepted();
  second.send("hello");
  until_data("hello");
}

TEST_F(StreamPortTest, ARefusedConnectionFailsAndSaysWhere) {
  number = test::free_port();
  make("tcp:127.0.0.1:" + std::to_string(number));
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("failed ");
  EXPECT_EQ(log.error.code, Errc::device_missing);
  EXPECT_NE(log.error.message.find("127.0.0.1:" + std::to_string(number)), std::string::npos);
  EXPECT_NE(log.error.message.find("refused"), std::string::npos) << log.error.message;
}

TEST_F(StreamPortTest, ANameIsTriedAtAllItsAddresses) {
  make("tcp:localhost:" + std::to_string(server.port()));  // ::1 first on most systems, where nobody listens
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("up ");
}

TEST_F(StreamPortTest, ANameThatDoesNotResolveFails) {
  make("tcp:no-such-host.invalid:2112");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("failed ");
  EXPECT_NE(log.error.message.find("no-such-host.invalid"), std::string::npos);
}

TEST_F(StreamPortTest, ClosingWhileANameIsLookedUpIsSafe) {
  make("tcp:no-such-host.invalid:2112");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->close();
  port.reset();
  run_ready();
  EXPECT_EQ(log.events, "");
}

TEST_F(StreamPortTest, AServerThatDoesNotAnswerFailsAfterTheTimeout) {
  Socket full = Socket::listening(0);
  const Socket first =
      Socket::connect_to(full.port());  // the backlog of 0 holds one; the next SYN is ignored
  make("tcp:127.0.0.1:" + std::to_string(full.port()) + ",timeout=0.05");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("failed ");
  EXPECT_NE(log.error.message.find("timed out"), std::string::npos) << log.error.message;
}

TEST_F(StreamPortTest, WhatTheDeviceSentComesBeforeItsClose) {
  make_connecting();
  port->open();
  Socket peer = accepted();
  peer.send("last words");
  peer.close();
  until("up closed ");
  EXPECT_EQ(log.data, "last words");
}

TEST_F(StreamPortTest, AResetOfTheDeviceIsALoss) {
  make_connecting();
  port->open();
  accepted().reset();
  until("up lost ");
  EXPECT_EQ(log.error.code, Errc::device_lost);
}

TEST_F(StreamPortTest, EndOfWritingReachesTheDeviceWhichMayStillAnswer) {
  make_connecting();
  port->open();
  Socket peer = accepted();
  port->write(as_bytes("question"));
  port->end_writing();
  until_got(peer, "question", "end");
  peer.send("answer");
  peer.close();
  until("up closed ");
  EXPECT_EQ(log.data, "answer");
}

TEST_F(StreamPortTest, AlwaysOpenConnectsAtOnceAndAgainAfterADrop) {
  make_connecting(",alwaysopen");
  run_until(loop, [&] { return server.readable(); });
  Socket first = server.accept();
  port->open();
  until("up ");
  first.close();
  until("up interrupted ");
  run_until(loop, [&] { return server.readable(); });
  Socket second = server.accept();
  until("up interrupted resumed ");
  port->write(as_bytes("still here"));
  until_got(second, "still here");
}

TEST_F(StreamPortTest, AlwaysOpenKeepsTheConnectionThroughClose) {
  make_connecting(",alwaysopen");
  port->open();
  Socket peer = accepted();
  port->end_writing();
  port->close();
  peer.send("noise");
  until_data("noise");
  port->open();
  port->write(as_bytes("x"));
  until_got(peer, "x");
}

TEST_F(StreamPortTest, WaitsForADeviceThatIsMissing) {
  number = test::free_port();
  make("tcp:127.0.0.1:" + std::to_string(number) + ",wait");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  run_until(loop, [&] { return book.text().find("trying again") != std::string::npos; });
  const SocketAddress address = *numeric_address("127.0.0.1", number);
  const int on = 1;
  const Socket late(UniqueFd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)));
  (void)::setsockopt(late.fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  ASSERT_EQ(::bind(late.fd(), address.get(), address.size), 0);
  ASSERT_EQ(::listen(late.fd(), 1), 0);
  until("up ");
}

TEST_F(StreamPortTest, ListensAndComesUpWithEachPeer) {
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

TEST_F(StreamPortTest, ASecondPeerWaitsUntilTheFirstIsGone) {
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

TEST_F(StreamPortTest, TenPeersInARowAreServed) {
  make_listening();
  for (int n = 0; n < 10; ++n) {
    Socket peer = up();
    peer.send(".");
    until_data(std::string(static_cast<std::size_t>(n + 1), '.'));
    peer.close();
    run_until(loop, [&] { return log.events.ends_with("closed "); });
  }
}

TEST_F(StreamPortTest, APeerThatResetsIsGone) {
  make_listening();
  up().reset();
  until("up closed ");
}

TEST_F(StreamPortTest, AHalfClosedPeerStillGetsItsAnswer) {
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

TEST_F(StreamPortTest, AHalfClosedPeerThatThenClosesIsNoticed) {
  make_listening();
  Socket peer = up();
  peer.end_sending();
  until("up ended ");
  peer.close();
  until("up ended closed ");
}

TEST_F(StreamPortTest, AHalfClosedPeerIsNotKeptWhereNobodyWantsIt) {
  make_listening();
  log.keep_ended = false;
  Socket peer = up();
  peer.end_sending();
  until("up ended closed ");
  until_got(peer, "", "end");
}

TEST_F(StreamPortTest, AQuietHalfClosedPeerIsClosedInTheEnd) {
  make_listening();
  Socket peer = up();
  peer.end_sending();
  until("up ended closed ");
  until_got(peer, "", "end");
}

TEST_F(StreamPortTest, HangingUpLetsThePeerReadFirst) {
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

TEST_F(StreamPortTest, HangingUpAtOnceResets) {
  make_listening();
  Socket peer = up();
  port->hang_up(false);
  until("up hung_up ");
  until_got(peer, "", "reset");
}

TEST_F(StreamPortTest, BytesAfterAHangUpAreCountedAndDropped) {
  make_listening();
  Socket peer = up();
  port->hang_up(true);
  peer.send("late");
  peer.close();
  until("up hung_up ");
  EXPECT_EQ(log.data, "");
  EXPECT_EQ(log.dropped, 4U);
}

TEST_F(StreamPortTest, ASlowPeerCongestsAndDrainsAndTheOtherWayStaysFree) {
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

TEST_F(StreamPortTest, NotReadingIsBackpressureToThePeer) {
  make_listening();
  Socket peer = up();
  port->set_reading(false);
  peer.send("later");
  run_ready();
  EXPECT_EQ(log.data, "");
  port->set_reading(true);
  until_data("later");
}

TEST_F(StreamPortTest, UnsentBytesAreCountedAtClose) {
  make_listening();
  Socket peer = up();
  port->write(as_bytes(std::string(std::size_t{16} << 20, 'x')));
  port->close();
  EXPECT_GT(log.dropped, 0U);
  EXPECT_EQ(log.events, "up ");
}

TEST_F(StreamPortTest, AWriteToAPeerThatIsGoneTakesTheLineDown) {
  make_listening();
  Socket peer = up();
  port->set_reading(false);  // only the write can notice
  peer.reset();
  port->write(as_bytes("x"));
  EXPECT_EQ(log.events, "up ");
  until("up closed ");
  EXPECT_EQ(log.dropped, 1U);
}

TEST_F(StreamPortTest, APortInUseIsAUsageError) {
  make("tcp-listen:" + std::to_string(server.port()));
  const Result<void> prepared = port->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
  EXPECT_NE(prepared.error().message.find("in use"), std::string::npos) << prepared.error().message;
}

TEST_F(StreamPortTest, AnAddressOfAnotherMachineCannotBeListenedOn) {
  make("tcp-listen:192.0.2.1:2112");
  const Result<void> prepared = port->prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
}

TEST_F(StreamPortTest, PortZeroIsPrinted) {
  make("tcp-listen:0");
  testing::internal::CaptureStdout();
  ASSERT_TRUE(port->prepare().has_value());
  const std::string printed = testing::internal::GetCapturedStdout();
  ASSERT_TRUE(printed.starts_with("127.0.0.1:")) << printed;
  port->open();
  number = static_cast<std::uint16_t>(std::stoi(printed.substr(10)));
  const Socket peer = up();
}

TEST_F(StreamPortTest, ListensOnIpv6) {
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
