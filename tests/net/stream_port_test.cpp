#include "tests/net/stream_port_rig.hpp"

namespace porttape {
namespace {

class ConnectingPort : public StreamPortRig {};

TEST_F(ConnectingPort, ConnectsAndPassesBytesBothWays) {
  make_connecting();
  port->open();
  EXPECT_EQ(log.events, "");
  Socket peer = accepted();
  port->write(as_bytes("ask"));
  until_got(peer, "ask");
  peer.send("answer");
  until_data("answer");
}

TEST_F(ConnectingPort, IsNotConnectedBeforeOpen) {
  make_connecting();
  run_ready();
  EXPECT_FALSE(server.readable());
}

TEST_F(ConnectingPort, ConnectsAgainAfterClose) {
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

TEST_F(ConnectingPort, ARefusedConnectionFailsAndSaysWhere) {
  const Socket nobody = Socket::bound();
  number = nobody.port();
  make("tcp:127.0.0.1:" + std::to_string(number));
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("failed ");
  EXPECT_EQ(log.error.code, Errc::device_missing);
  EXPECT_NE(log.error.message.find("127.0.0.1:" + std::to_string(number)), std::string::npos);
  EXPECT_NE(log.error.message.find("refused"), std::string::npos) << log.error.message;
}

TEST_F(ConnectingPort, ANameIsTriedAtAllItsAddresses) {
  make("tcp:localhost:" + std::to_string(server.port()));  // ::1 first on most systems, where nobody listens
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("up ");
}

TEST_F(ConnectingPort, ANameThatDoesNotResolveFails) {
  make("tcp:no-such-host.invalid:2112");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("failed ");
  EXPECT_NE(log.error.message.find("no-such-host.invalid"), std::string::npos);
}

TEST_F(ConnectingPort, ClosingWhileANameIsLookedUpIsSafe) {
  make("tcp:no-such-host.invalid:2112");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  port->close();
  port.reset();
  run_ready();
  EXPECT_EQ(log.events, "");
}

TEST_F(ConnectingPort, AServerThatDoesNotAnswerFailsAfterTheTimeout) {
  Socket full = Socket::listening(0);
  const Socket first =
      Socket::connect_to(full.port());  // the backlog of 0 holds one; the next SYN is ignored
  make("tcp:127.0.0.1:" + std::to_string(full.port()) + ",timeout=0.05");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  until("failed ");
  EXPECT_NE(log.error.message.find("timed out"), std::string::npos) << log.error.message;
}

TEST_F(ConnectingPort, WhatTheDeviceSentComesBeforeItsClose) {
  make_connecting();
  port->open();
  Socket peer = accepted();
  peer.send("last words");
  peer.close();
  until("up closed ");
  EXPECT_EQ(log.data, "last words");
}

TEST_F(ConnectingPort, AResetOfTheDeviceIsALoss) {
  make_connecting();
  port->open();
  accepted().reset();
  until("up lost ");
  EXPECT_EQ(log.error.code, Errc::device_lost);
}

TEST_F(ConnectingPort, EndOfWritingReachesTheDeviceWhichMayStillAnswer) {
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

TEST_F(ConnectingPort, AlwaysOpenConnectsAtOnceAndAgainAfterADrop) {
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

TEST_F(ConnectingPort, APeerThatClosesAtOnceIsCalledAgainEverLater) {
  make_connecting(",alwaysopen");
  const auto called = [this] {
    run_until(loop, [this] { return server.readable(); });
    return server.accept();
  };
  port->open();
  const Instant begin = loop.now();
  for (int n = 0; n < 4; ++n) called().close();
  EXPECT_GE(loop.now() - begin, std::chrono::milliseconds(100 + 200 + 400));
  Socket talks = called();
  talks.send("hello");
  until_data("hello");
}

TEST_F(ConnectingPort, AlwaysOpenKeepsTheConnectionThroughClose) {
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

TEST_F(ConnectingPort, WaitsForADeviceThatIsMissing) {
  const Socket late = Socket::bound();
  make("tcp:127.0.0.1:" + std::to_string(late.port()) + ",wait");
  ASSERT_TRUE(port->prepare().has_value());
  port->open();
  run_until(loop, [&] { return book.text().find("trying again") != std::string::npos; });
  EXPECT_EQ(log.events, "");
  late.listen();
  until("up ");
}

}  // namespace
}  // namespace porttape
