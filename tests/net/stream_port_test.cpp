#include <algorithm>
#include <chrono>
#include <memory>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <string>
#include <sys/socket.h>

#include "libport/loop/backoff.hpp"
#include "libport/net/socket_address.hpp"
#include "tests/net/stream_port_rig.hpp"
#include "tests/support/manual_clock.hpp"

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

int option_of(int fd, int level, int option) {
  int value = -1;
  socklen_t size = sizeof value;
  EXPECT_EQ(::getsockopt(fd, level, option, &value, &size), 0);
  return value;
}

// The descriptor in this program of the other end of a connection.
int other_end_of(int fd) {
  const SocketAddress here = local_address(fd);
  const SocketAddress there = peer_address(fd);
  for (int other = 0; other < 1024; ++other) {
    if (same_host_and_port(local_address(other), there) && same_host_and_port(peer_address(other), here))
      return other;
  }
  return -1;
}

TEST_F(ConnectingPort, SendsAtOnceAndNoticesAPeerThatHasVanishedInAMinuteAndAHalf) {
  make_connecting();
  port->open();
  const Socket peer = accepted();
  const int fd = other_end_of(peer.fd());
  ASSERT_GE(fd, 0);
  EXPECT_NE(option_of(fd, IPPROTO_TCP, TCP_NODELAY), 0);
  EXPECT_NE(option_of(fd, SOL_SOCKET, SO_KEEPALIVE), 0);
  EXPECT_EQ(option_of(fd, IPPROTO_TCP, TCP_KEEPIDLE), 60);
  EXPECT_EQ(option_of(fd, IPPROTO_TCP, TCP_KEEPINTVL), 10);
  EXPECT_EQ(option_of(fd, IPPROTO_TCP, TCP_KEEPCNT), 3);
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

TEST_F(ConnectingPort, IsDrainedWhenTheConnectionThatIsKeptIsClosed) {
  make_connecting(",alwaysopen");
  port->open();
  const Socket peer = accepted();
  port->write(as_bytes(std::string(std::size_t{16} << 20, 'x')));
  int done = 0;
  log.drain(*port, [&done] { ++done; });
  port->close();
  EXPECT_EQ(done, 0) << "not from within the call";
  run_ready();
  EXPECT_EQ(done, 1);
  EXPECT_GT(log.dropped, 0U);
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

// By a clock that is moved: when it is tried again.
class RetryingPort : public testing::Test {
 protected:
  using Socket = test::Socket;
  void make(const std::string& more) {
    const Result<PortSpec> options = parse_port("tcp:127.0.0.1:" + std::to_string(deaf.port()) + more);
    ASSERT_TRUE(options.has_value()) << options.error().message;
    Result<std::unique_ptr<Port>> made = make_port({&loop, book.log()}, *options, "test");
    ASSERT_TRUE(made.has_value());
    port = std::move(*made);
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
  }
  // How long until it tries next. The kernel refuses at once.
  Nanos next_try() {
    settle(loop);
    return loop.next_timer() ? *loop.next_timer() - clock.now() : Nanos(-1);
  }
  void try_again() {
    clock.pass(std::max(Nanos(0), next_try()));
    loop.clock_moved();
    settle(loop);
    // The attempt itself begins at once, from the loop.
    while (next_try() == Nanos(0)) {
      loop.clock_moved();
      settle(loop);
    }
  }

  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  PortLog log;
  Socket deaf = Socket::bound();
  std::unique_ptr<Port> port;
};

TEST_F(RetryingPort, TriesAgainEverLaterUpToFiveSeconds) {
  make(",wait");
  port->open();
  while (next_try() != std::chrono::milliseconds(100)) {
    ASSERT_LE(next_try(), Nanos(0)) << "the first attempt is at once";
    loop.clock_moved();
    settle(loop);
  }
  for (const int wait : {200, 400, 800, 1600, 3200, 5000, 5000}) {
    try_again();
    EXPECT_EQ(next_try(), std::chrono::milliseconds(wait));
  }
  EXPECT_EQ(log.events, "");
  EXPECT_EQ(book.text().find("trying again"), book.text().rfind("trying again")) << "it is told once";
}

TEST_F(RetryingPort, ACloseEndsTheTrying) {
  make(",wait");
  port->open();
  try_again();
  port->close();
  EXPECT_EQ(next_try(), Nanos(-1));
}

TEST_F(RetryingPort, AMissingDeviceIsAFailureWhereItIsNotWaitedFor) {
  make("");
  port->open();
  run_until(loop, [this] {
    loop.clock_moved();
    return !log.events.empty();
  });
  EXPECT_EQ(log.events, "failed ");
  EXPECT_EQ(log.error.code, Errc::device_missing);
}

// A device that does not answer: the kernel holds one connection for it, and takes no more.
class UnansweredPort : public RetryingPort {
 protected:
  UnansweredPort() {
    deaf.listen(0);
    first = Socket::connect_to(deaf.port());
  }
  // How long until it fails.
  Nanos limit(const std::string& more) {
    make(more);
    port->open();
    const Instant begin = clock.now();
    EXPECT_TRUE(let_pass(loop, clock, std::chrono::minutes(1), [this] { return log.events == "failed "; }));
    return clock.now() - begin;
  }
  Socket first;
};

TEST_F(UnansweredPort, IsGivenUpAfterTenSeconds) { EXPECT_EQ(limit(""), std::chrono::seconds(10)); }

TEST_F(UnansweredPort, ATimeoutIsTheLimit) { EXPECT_EQ(limit(",timeout=3"), std::chrono::seconds(3)); }

TEST_F(UnansweredPort, ATimeoutOfNothingIsNoLimit) {
  EXPECT_EQ(limit(",timeout=0"), std::chrono::seconds(10));
}

// A device that takes each connection, and drops it.
class DroppingPort : public RetryingPort {
 protected:
  DroppingPort() {
    deaf.listen();
    make(",alwaysopen");
    port->open();
    settle(loop);
    (void)let_pass(loop, clock, Nanos(1));
  }
  // Takes the connection, lets it be for that long, and drops it. How long until the next attempt.
  Nanos drop_after(Nanos time) {
    (void)let_pass(loop, clock, std::chrono::seconds(6), [this] { return deaf.readable(); });
    Socket peer = deaf.accept();
    settle(loop);
    (void)let_pass(loop, clock, time);
    peer.close();
    settle(loop);
    return next_try();
  }
};

TEST_F(DroppingPort, IsCalledAgainEverLater) {
  EXPECT_EQ(drop_after(Nanos(0)), std::chrono::milliseconds(100));
  EXPECT_EQ(drop_after(Nanos(0)), std::chrono::milliseconds(200));
  EXPECT_EQ(drop_after(Nanos(0)), std::chrono::milliseconds(400));
}

TEST_F(DroppingPort, IsCalledSoonAgainWhereItsLineHeldForASecond) {
  EXPECT_EQ(drop_after(Nanos(0)), std::chrono::milliseconds(100));
  EXPECT_EQ(drop_after(kLineHeld - Nanos(1)), std::chrono::milliseconds(200));
  EXPECT_EQ(drop_after(kLineHeld), std::chrono::milliseconds(100));
  EXPECT_EQ(drop_after(Nanos(0)), std::chrono::milliseconds(200));
}

}  // namespace
}  // namespace porttape
