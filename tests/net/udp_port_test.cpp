#include "libport/net/udp_port.hpp"

#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {
namespace {

using test::Socket;

class UdpPortTest : public testing::Test {
 protected:
  void make(const std::string& spec) {
    const Result<PortSpec> options = parse_port(spec);
    ASSERT_TRUE(options.has_value()) << options.error().message;
    port = std::make_unique<UdpPort>(PortContext{&loop, book.log()}, options->common(),
                                     *options->get<UdpOptions>());
    port->listen(log);
    number = test::prepare_any(*port);
  }
  void make_sending() {
    make("udp:127.0.0.1:" + std::to_string(peer.port()) + ",recv_ip=127.0.0.1,recv_port=0");
    port->open();
  }
  void make_listening() {
    make("udp-listen:0");
    port->open();
  }
  // More than the port's socket holds.
  void flood() const {
    const std::string datagram(60'000, 'd');
    for (int n = 0; n < 200; ++n) peer.send_to(number, datagram);
  }
  [[nodiscard]] bool overflow_told() const {
    return book.text().find("came faster than they were read") != std::string::npos;
  }
  // One datagram that is there.
  static std::string one(const Socket& socket) {
    std::vector<char> buffer(65536);
    const ssize_t size = ::recv(socket.fd(), buffer.data(), buffer.size(), 0);
    return size < 0 ? "nothing" : std::string(buffer.data(), static_cast<std::size_t>(size));
  }

  Loop loop;
  LogBook book;
  PortLog log;
  Socket peer = Socket::datagrams();
  std::uint16_t number = 0;
  std::unique_ptr<UdpPort> port;
};

TEST_F(UdpPortTest, AnEmptyDatagramOpensALineAsAnyOther) {
  make_listening();
  peer.send_to(number, "");
  run_until(loop, [&] { return !log.events.empty(); });
  EXPECT_EQ(log.events, "up ");
  peer.send_to(number, "x");
  run_until(loop, [&] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "x");
}

TEST_F(UdpPortTest, IsDrainedOnceTheKernelHasItAll) {
  make_sending();
  port->write(as_bytes("x"));
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  run_until(loop, [&done] { return done; });
  EXPECT_EQ(one(peer), "x");
}

TEST_F(UdpPortTest, OnlyThePeersDatagramsCount) {
  make_sending();
  const Socket stranger = Socket::datagrams();
  stranger.send_to(number, "foreign");
  stranger.send_to(number, "again");
  peer.send_to(number, "mine");
  while (log.data.empty()) loop.run_one();
  EXPECT_EQ(log.data, "mine");
  const std::string to = "127.0.0.1:" + std::to_string(peer.port());
  EXPECT_NE(book.text().find("udp:" + to + ": a datagram from 127.0.0.1:" + std::to_string(stranger.port()) +
                             ", which is not the peer " + to + ", is dropped; from=any takes all"),
            std::string::npos)
      << book.text();
  port->close();
  EXPECT_NE(book.text().find("2 datagrams of others"), std::string::npos) << book.text();
}

TEST_F(UdpPortTest, ManyForeignOnesAreToldOnceAndCountedAtTheClose) {
  make_sending();
  const Socket stranger = Socket::datagrams();
  for (int n = 0; n < 50; ++n) stranger.send_to(number, "foreign");
  peer.send_to(number, "mine");
  while (log.data.empty()) loop.run_one();
  EXPECT_EQ(book.text().find("is dropped; from=any"), book.text().rfind("is dropped; from=any"));
  port->close();
  EXPECT_NE(book.text().find("50 datagrams of others than the peer were dropped"), std::string::npos);
  port->open();
  port->close();
  EXPECT_EQ(book.text().find("datagrams of others"), book.text().rfind("datagrams of others")) << "once";
}

TEST_F(UdpPortTest, WhatIsWrittenBeforeThePeerIsKnownIsTold) {
  make_listening();
  port->write(as_bytes("early"));
  EXPECT_EQ(log.dropped, 5U);
  EXPECT_EQ(log.why, "the line is not up");
}

TEST_F(UdpPortTest, APortForReadingOnlySendsNothing) {
  make("udp:127.0.0.1:" + std::to_string(peer.port()) + ",recv_ip=127.0.0.1,recv_port=0,readonly");
  port->open();
  port->write(as_bytes("unwanted"));
  EXPECT_EQ(log.dropped, 8U);
  EXPECT_EQ(log.why, "the port is for reading only");
  EXPECT_EQ(one(peer), "nothing");
}

TEST_F(UdpPortTest, APortForWritingOnlyTakesNothing) {
  make("udp:127.0.0.1:" + std::to_string(peer.port()) + ",recv_ip=127.0.0.1,recv_port=0,writeonly");
  port->open();
  peer.send_to(number, "unwanted");
  run_until(loop, [&] { return log.dropped > 0; });
  EXPECT_EQ(log.dropped, 8U);
  EXPECT_EQ(log.why, "the port is for writing only");
  EXPECT_EQ(log.data, "");
}

TEST_F(UdpPortTest, AWriteThatIsTooLargeForOneIsSeveral) {
  make_sending();
  port->write(as_bytes(std::string(65507, 'x') + "rest"));
  EXPECT_EQ(one(peer).size(), 65507U);
  EXPECT_EQ(one(peer), "rest");
  EXPECT_EQ(one(peer), "nothing");
}

TEST_F(UdpPortTest, WhatIsPendingIsReadWhereReadingIsOn) {
  make_sending();
  peer.send_to(number, "one");
  peer.send_to(number, "two");
  port->set_reading(false);
  port->read_pending();
  EXPECT_EQ(log.data, "");
  port->set_reading(true);
  port->read_pending();
  EXPECT_EQ(log.data, "onetwo");
}

TEST_F(UdpPortTest, AllEmptyOnesOfASessionAreToldAtItsEnd) {
  make_sending();
  for (int n = 0; n < 3; ++n) peer.send_to(number, "");
  peer.send_to(number, "x");
  run_until(loop, [&] { return log.data == "x"; });
  EXPECT_EQ(book.text().find("empty datagrams"), std::string::npos);
  port->close();
  EXPECT_NE(book.text().find("3 empty datagrams, which a tape cannot hold, were dropped"), std::string::npos);
  port->open();
  port->close();
  EXPECT_EQ(book.text().find("empty datagrams"), book.text().rfind("empty datagrams")) << "once";
}

TEST_F(UdpPortTest, OfAClosedPortNothingIsToldWhereNothingCame) {
  make_sending();
  port->close();
  port->open();
  EXPECT_EQ(book.text().find("while it was closed"), std::string::npos) << book.text();
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(UdpPortTest, HowManyCameWhileItWasClosedIsTold) {
  make_sending();
  port->close();
  for (int n = 0; n < 3; ++n) peer.send_to(number, "old");
  port->open();
  EXPECT_NE(book.text().find("3 datagrams came while it was closed"), std::string::npos) << book.text();
  loop.poll_one();
  EXPECT_EQ(log.data, "");
}

TEST_F(UdpPortTest, ItsNameAndPlaceAreThoseOfThePeerOrItsOwn) {
  make_sending();
  const std::string to = std::to_string(peer.port());
  EXPECT_EQ(port->name(), "udp:127.0.0.1:" + to);
  EXPECT_EQ(port->place().host, "127.0.0.1");
  EXPECT_EQ(port->place().port, peer.port());
  EXPECT_FALSE(port->passive());
  EXPECT_TRUE(port->keeps_datagrams());
  make_listening();
  EXPECT_EQ(port->name(), "udp-listen:127.0.0.1:" + std::to_string(number));
  EXPECT_EQ(port->place().port, number);
}

TEST_F(UdpPortTest, AnAddressThatIsNotOfThisMachineIsRefused) {
  const Result<PortSpec> options = parse_port("udp-listen:192.0.2.1:0");
  ASSERT_TRUE(options.has_value()) << options.error().message;
  UdpPort other(PortContext{&loop, book.log()}, options->common(), *options->get<UdpOptions>());
  other.listen(log);
  const Result<void> ready = other.prepare();
  ASSERT_FALSE(ready);
  EXPECT_EQ(ready.error().code, Errc::usage);
  EXPECT_EQ(ready.error().message,
            "cannot receive on 192.0.2.1:0: Cannot assign requested address; choose another recv_ip or "
            "recv_port");
}

TEST_F(UdpPortTest, APeerOfTheOtherFamilyNeedsAnAddressOfItsOwn) {
  make("udp:[::1]:9,recv_ip=*,recv_port=0");
  EXPECT_EQ(port->name(), "udp:[::1]:9");
  port->open();
  EXPECT_EQ(log.events, "up ");
}

TEST_F(UdpPortTest, AnybodysDatagramsCountWhereThatIsWanted) {
  make("udp:127.0.0.1:" + std::to_string(peer.port()) + ",recv_ip=127.0.0.1,recv_port=0,from=any");
  port->open();
  Socket::datagrams().send_to(number, "foreign");
  while (log.data.empty()) loop.run_one();
  EXPECT_EQ(log.data, "foreign");
}

TEST_F(UdpPortTest, EachWriteIsADatagram) {
  make_sending();
  EXPECT_EQ(log.events, "up ");
  port->write(as_bytes("one"));
  port->write(as_bytes("three"));
  EXPECT_EQ(one(peer), "one");
  EXPECT_EQ(one(peer), "three");
}

TEST_F(UdpPortTest, AHungUpLineDropsWhatOpenedItAndRests) {
  make_listening();
  port->set_reading(false);  // as a session does until its device is up
  peer.send_to(number, "first");
  run_until(loop, [&] { return log.events == "up "; });
  port->hang_up(false);
  run_until(loop, [&] { return log.events == "up hung_up "; });
  EXPECT_EQ(log.dropped, 5U);
  peer.send_to(number, "second");
  run_until(loop, [&] { return log.events == "up hung_up up "; });
  port->set_reading(true);
  run_until(loop, [&] { return log.data == "second"; });
}

TEST_F(UdpPortTest, DatagramsThatTheKernelDropsAreTold) {
  make_listening();
  flood();
  // The count comes with a datagram that found room again.
  run_until(loop, [&] {
    peer.send_to(number, "x");
    return overflow_told();
  });
  EXPECT_TRUE(overflow_told());
}

TEST_F(UdpPortTest, DatagramsThatTheKernelDropsLastAreToldAtTheClose) {
  make_listening();
  flood();
  port->close();
  EXPECT_TRUE(overflow_told()) << book.text();
}

TEST_F(UdpPortTest, TheLargestDatagramStaysWholeBothWays) {
  make_sending();
  const std::string largest(65507, 'x');
  port->write(as_bytes(largest));
  EXPECT_EQ(one(peer), largest);
  peer.send_to(number, largest);
  run_until(loop, [&] { return !log.data.empty(); });
  EXPECT_EQ(log.data, largest);
}

TEST_F(UdpPortTest, ComesUpWithTheFirstDatagramAndAnswersTheLatestSender) {
  make_listening();
  EXPECT_TRUE(port->passive());
  EXPECT_EQ(log.events, "");
  peer.send_to(number, "hello");
  run_until(loop, [&] { return log.data == "hello"; });
  EXPECT_EQ(log.events, "up ");
  port->write(as_bytes("to the first"));
  EXPECT_EQ(one(peer), "to the first");
  const Socket other = Socket::datagrams();
  other.send_to(number, "!");
  run_until(loop, [&] { return log.data == "hello!"; });
  port->write(as_bytes("to the second"));
  EXPECT_EQ(one(other), "to the second");
}

// Stops reading as soon as it is told of the line, as a session does whose device is not there yet.
class Waiting final : public PortListener {
 public:
  explicit Waiting(Port& owner) : port(owner) {}
  void on_up() override { port.set_reading(false), up = true; }
  void on_data(ByteView bytes) override { data += as_text(bytes); }
  void on_drained() override {}
  void on_down(const LineDown&) override {}
  void on_finished(int) override {}
  void on_complete(int) override {}
  Port& port;
  bool up = false;
  std::string data;
};

TEST_F(UdpPortTest, TheFirstDatagramWaitsUntilItIsWanted) {
  make_listening();
  Waiting waiting(*port);
  port->listen(waiting);
  peer.send_to(number, "hello");
  run_until(loop, [&] { return waiting.up; });
  EXPECT_EQ(waiting.data, "");
  port->set_reading(true);
  run_until(loop, [&] { return waiting.data == "hello"; });
}

TEST_F(UdpPortTest, EmptyDatagramsAreDroppedAndTold) {
  make_sending();
  peer.send_to(number, "");
  peer.send_to(number, "x");
  run_until(loop, [&] { return log.data == "x"; });
  port->close();
  EXPECT_NE(book.text().find("1 empty datagrams"), std::string::npos) << book.text();
}

TEST_F(UdpPortTest, WhatCameWhileItWasClosedIsNotReadWhateverIsAmongIt) {
  make_sending();
  port->close();
  peer.send_to(number, "");
  peer.send_to(number, "old");
  port->open();
  peer.send_to(number, "new");
  run_until(loop, [&] { return log.data.ends_with("new"); });
  EXPECT_EQ(log.data, "new");
  EXPECT_NE(book.text().find("2 datagrams came while it was closed"), std::string::npos) << book.text();
}

TEST_F(UdpPortTest, ADatagramThatCannotBeSentIsCountedAndTheLineStaysUp) {
  make("udp:255.255.255.255:9,recv_ip=127.0.0.1,recv_port=0");  // broadcasting is not allowed
  port->open();
  port->write(as_bytes("four"));
  port->write(as_bytes("four"));
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.dropped, 8U);
  EXPECT_EQ(log.why, "a datagram could not be sent");
  const std::string told =
      "udp:255.255.255.255:9: a datagram of 4 bytes to 255.255.255.255:9 is dropped: Permission denied";
  const std::size_t at = book.text().find(told);
  EXPECT_NE(at, std::string::npos) << book.text();
  EXPECT_EQ(book.text().rfind(told), at) << "once a session";
  port->close();
  port->open();
  port->write(as_bytes("four"));
  EXPECT_NE(book.text().rfind(told), at) << "and once in the next";
}

TEST_F(UdpPortTest, WhatCameWhileClosedIsNotForTheNextSession) {
  make_sending();
  port->close();
  peer.send_to(number, "old");
  port->open();
  peer.send_to(number, "new");
  run_until(loop, [&] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "new");
}

TEST_F(UdpPortTest, AfterAHangUpTheNextDatagramOpensAgain) {
  make_listening();
  peer.send_to(number, "a");
  run_until(loop, [&] { return log.data == "a"; });
  port->hang_up(true);
  run_until(loop, [&] { return log.events == "up hung_up "; });
  peer.send_to(number, "b");
  run_until(loop, [&] { return log.data == "ab"; });
  EXPECT_EQ(log.events, "up hung_up up ");
}

TEST_F(UdpPortTest, APortInUseIsAUsageError) {
  UdpPort second({&loop, book.log()}, {}, {.own_host = "127.0.0.1", .own_port = peer.port(), .listen = true});
  const Result<void> prepared = second.prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
}

}  // namespace
}  // namespace porttape
