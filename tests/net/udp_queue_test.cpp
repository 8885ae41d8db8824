// Datagrams that the kernel does not take at once, and what a UDP port tells of those it loses.

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <memory>
#include <netinet/in.h>
#include <string>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "libport/net/udp_port.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/sockets.hpp"

namespace {

int send_refused = 0;  // the error that sendto() gives; 0: none

}  // namespace

// In the place of the C library's, for this program.
// NOLINTNEXTLINE(readability-inconsistent-declaration-parameter-name)
extern "C" ssize_t sendto(int fd, const void* data, size_t size, int flags, const sockaddr* address,
                          socklen_t address_size) {
  if (send_refused != 0) {
    errno = send_refused;
    return -1;
  }
  return ::syscall(SYS_sendto, fd, data, size, flags, address, address_size);
}

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::Socket;
using testing::HasSubstr;
using testing::Not;

class UdpQueueTest : public testing::Test {
 protected:
  ~UdpQueueTest() override { send_refused = 0; }
  void make(const std::string& spec) {
    const Result<PortSpec> options = parse_port(spec);
    ASSERT_TRUE(options.has_value()) << options.error().message;
    port = std::make_unique<UdpPort>(PortContext{&loop, book.log()}, options->common(),
                                     *options->get<UdpOptions>());
    port->listen(log);
    number = test::prepare_any(*port);
    port->open();
    settle(loop);
  }
  void make_sending(const std::string& more = {}) {
    make("udp:127.0.0.1:" + std::to_string(peer.port()) + ",recv_ip=127.0.0.1,recv_port=0" + more);
  }
  void make_listening() { make("udp-listen:0"); }
  // All that has come to the peer, a comma between two.
  std::string got() const {
    std::string all;
    std::vector<char> buffer(65536);
    for (ssize_t size = 0; (size = ::recv(peer.fd(), buffer.data(), buffer.size(), 0)) >= 0;)
      all += (all.empty() ? "" : ",") + std::string(buffer.data(), static_cast<std::size_t>(size));
    return all;
  }
  // One turn of the loop, which looks at the socket once.
  void turn() { (void)loop.poll_one(); }

  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  PortLog log;
  Socket peer = Socket::datagrams();
  std::uint16_t number = 0;
  std::unique_ptr<UdpPort> port;
};

TEST_F(UdpQueueTest, WhatTheKernelDoesNotTakeWaitsInItsOrder) {
  make_sending();
  send_refused = EAGAIN;
  port->write(as_bytes("one"));
  EXPECT_TRUE(port->congested());
  send_refused = 0;
  port->write(as_bytes("three"));
  EXPECT_EQ(port->unread_by_peer(), 8U);
  EXPECT_EQ(got(), "") << "none overtakes another";
  settle(loop);
  EXPECT_EQ(got(), "one,three");
  EXPECT_EQ(log.events, "up drained ");
  EXPECT_FALSE(port->congested());
  EXPECT_EQ(port->unread_by_peer(), 0U);
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(UdpQueueTest, AnInterruptedSendIsTriedAgain) {
  make_sending();
  send_refused = EINTR;
  port->write(as_bytes("one"));
  send_refused = 0;
  settle(loop);
  EXPECT_EQ(got(), "one");
}

TEST_F(UdpQueueTest, WhileTheKernelTakesNothingNothingIsDrained) {
  make_sending();
  send_refused = EAGAIN;
  port->write(as_bytes("one"));
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  for (int n = 0; n < 10; ++n) turn();
  EXPECT_FALSE(done);
  EXPECT_EQ(log.events, "up ");
  send_refused = 0;
  settle(loop);
  EXPECT_TRUE(done);
  EXPECT_EQ(log.events, "up drained ") << "once";
}

TEST_F(UdpQueueTest, ADrainOfNothingIsDoneAtOnce) {
  make_sending();
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  EXPECT_TRUE(done);
}

TEST_F(UdpQueueTest, OneThatCannotBeSentLaterIsDroppedAndTheNextGoes) {
  make_sending();
  send_refused = EAGAIN;
  port->write(as_bytes("one"));
  send_refused = EPERM;
  turn();
  EXPECT_EQ(log.dropped, 3U);
  EXPECT_EQ(log.why, "a datagram could not be sent");
  send_refused = 0;
  settle(loop);
  port->write(as_bytes("two"));
  EXPECT_EQ(got(), "two");
}

TEST_F(UdpQueueTest, WhatIsQueuedAtTheCloseIsTold) {
  make_sending();
  send_refused = EAGAIN;
  port->write(as_bytes("x"));
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  port->close();
  EXPECT_FALSE(done) << "not from within the call";
  send_refused = 0;
  settle(loop);
  EXPECT_TRUE(done);
  EXPECT_EQ(log.dropped, 1U);
  EXPECT_EQ(log.why, "they were not sent");
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(got(), "");
}

TEST_F(UdpQueueTest, WhatIsQueuedAtAHangUpIsTold) {
  make_listening();
  peer.send_to(number, "hello");
  settle(loop);
  send_refused = EAGAIN;
  port->write(as_bytes("answer"));
  port->hang_up(true);
  send_refused = 0;
  settle(loop);
  EXPECT_EQ(log.dropped, 6U);
  EXPECT_EQ(log.why, "they were not sent");
  EXPECT_EQ(log.events, "up hung_up ");
  EXPECT_EQ(got(), "");
}

TEST_F(UdpQueueTest, ADiscardTakesWhatIsQueuedAndWhatHasCome) {
  make_sending();
  peer.send_to(number, "come");
  send_refused = EAGAIN;
  port->write(as_bytes("queued"));
  bool done = false;
  log.drain(*port, [&done] { done = true; });
  EXPECT_TRUE(port->waiting()->discard());
  send_refused = 0;
  settle(loop);
  EXPECT_TRUE(done);
  EXPECT_EQ(got(), "");
  EXPECT_EQ(log.data, "");
  EXPECT_EQ(log.dropped, 0U) << "it was asked for";
  EXPECT_EQ(log.events, "up ");
}

TEST_F(UdpQueueTest, AWriteOfSomeTakesAWholeDatagram) {
  make_sending();
  EXPECT_EQ(port->waiting()->write_some(as_bytes("whole")), 5U);
  EXPECT_EQ(port->waiting()->unsent(), 0U);
  EXPECT_EQ(got(), "whole");
}

TEST_F(UdpQueueTest, AnEndOfAQuietLineTellsNothing) {
  make_listening();
  peer.send_to(number, "hello");
  settle(loop);
  port->hang_up(true);
  settle(loop);
  port->close();
  EXPECT_EQ(log.why, "");
  EXPECT_THAT(book.text(), Not(HasSubstr("were dropped")));
}

TEST_F(UdpQueueTest, AHungUpLineThatWasNotUpTellsNothing) {
  make_listening();
  port->hang_up(true);
  settle(loop);
  EXPECT_EQ(log.events, "");
  peer.send_to(number, "hello");
  settle(loop);
  EXPECT_EQ(log.data, "hello") << "it listens still";
}

TEST_F(UdpQueueTest, OneByteThatWaitedAtAHangUpIsTold) {
  make_listening();
  port->set_reading(false);
  peer.send_to(number, "x");
  settle(loop);
  port->hang_up(false);
  EXPECT_EQ(log.dropped, 1U);
  EXPECT_EQ(log.why, "the line was hung up");
}

TEST_F(UdpQueueTest, AHungUpLineRestsATenthOfASecond) {
  make_listening();
  peer.send_to(number, "first");
  settle(loop);
  port->hang_up(false);
  settle(loop);
  peer.send_to(number, "second");
  (void)let_pass(loop, clock, milliseconds(100) - Nanos(1));
  EXPECT_EQ(log.events, "up hung_up ");
  (void)let_pass(loop, clock, Nanos(1));
  EXPECT_EQ(log.events, "up hung_up up ");
  EXPECT_EQ(log.data, "firstsecond");
}

TEST_F(UdpQueueTest, AClosedLineDoesNotComeUpAfterItsRest) {
  make_listening();
  peer.send_to(number, "first");
  settle(loop);
  port->hang_up(false);
  settle(loop);
  port->close();
  peer.send_to(number, "second");
  (void)let_pass(loop, clock, seconds(1));
  EXPECT_EQ(log.events, "up hung_up ");
}

TEST_F(UdpQueueTest, ASendingLineThatWasHungUpStaysDown) {
  make_sending();
  port->hang_up(false);
  settle(loop);
  peer.send_to(number, "late");
  (void)let_pass(loop, clock, seconds(1));
  EXPECT_EQ(log.events, "up hung_up ");
  EXPECT_EQ(log.data, "");
  port->write(as_bytes("late"));
  EXPECT_EQ(log.why, "the line is not up");
}

TEST_F(UdpQueueTest, ThirtyTwoDatagramsAreReadATurn) {
  make_sending();
  for (int n = 0; n < 40; ++n) peer.send_to(number, "x");
  while (log.calls == 0) turn();
  EXPECT_EQ(log.calls, 32);
  settle(loop);
  EXPECT_EQ(log.calls, 40);
}

TEST_F(UdpQueueTest, OneEmptyDatagramIsToldAtTheHangUp) {
  make_sending();
  peer.send_to(number, "");
  settle(loop);
  EXPECT_EQ(log.calls, 0);
  port->hang_up(false);
  EXPECT_EQ(log.why, "1 empty datagrams, which a tape cannot hold, were dropped");
  EXPECT_EQ(log.dropped, 0U);
}

TEST_F(UdpQueueTest, OneForeignDatagramIsTold) {
  make_sending();
  Socket::datagrams().send_to(number, "foreign");
  settle(loop);
  port->close();
  EXPECT_THAT(book.text(), HasSubstr(": 1 datagrams of others than the peer were dropped"));
}

TEST_F(UdpQueueTest, TheNumberOfThoseThatTheKernelLostIsExact) {
  make_listening();
  const std::string large(60'000, 'd');
  for (int n = 0; n < 100; ++n) peer.send_to(number, large);
  settle(loop);
  ASSERT_LT(log.calls, 100);
  port->close();
  EXPECT_EQ(log.why,
            std::to_string(100 - log.calls) + " datagrams came faster than they were read and are lost");
  log.why.clear();
  port->open();
  port->close();
  EXPECT_EQ(log.why, "") << "it was told";
}

TEST_F(UdpQueueTest, WhatAHungUpListenerSendsNextGoesToTheNextPeer) {
  make_listening();
  peer.send_to(number, "first");
  settle(loop);
  port->hang_up(false);
  settle(loop);
  port->write(as_bytes("to nobody"));
  EXPECT_EQ(log.dropped, 9U);
  EXPECT_EQ(got(), "");
}

TEST_F(UdpQueueTest, ADestroyedPortThatWasHungUpTellsNobody) {
  make_sending();
  port->hang_up(false);
  port.reset();
  settle(loop);
  EXPECT_EQ(log.events, "up ");
}

TEST_F(UdpQueueTest, SwitchingReadingOnBeforeTheLineIsUpReadsNothing) {
  make_sending();
  port->close();
  port->set_reading(false);
  port->set_reading(true);
  peer.send_to(number, "old");
  settle(loop);
  EXPECT_EQ(log.data, "");
  EXPECT_EQ(log.events, "up ");
}

TEST_F(UdpQueueTest, AListenersLineThatIsReadByPendingComesUpFirst) {
  make_listening();
  peer.send_to(number, "hello");
  port->read_pending();
  EXPECT_EQ(log.data, "") << "it is not up";
  settle(loop);
  EXPECT_EQ(log.data, "hello");
}

TEST_F(UdpQueueTest, WhatCannotBeSentIsToldOnceForEachReasonAndTheNextIsSent) {
  make_sending();
  const std::string to = "datagram of 3 bytes to 127.0.0.1:" + std::to_string(peer.port()) + " is dropped: ";
  const std::pair<int, std::string> cases[] = {
      {ENETUNREACH, "Network is unreachable"}, {EHOSTUNREACH, "No route to host"},
      {ECONNREFUSED, "Connection refused"},    {EPERM, "Operation not permitted"},
      {ENOBUFS, "No buffer space available"},  {ENOMEM, "Cannot allocate memory"}};
  std::uint64_t dropped = 0;
  for (const auto& [error, why] : cases) {
    send_refused = error;
    for (int n = 0; n < 2; ++n) port->write(as_bytes("one"));
    EXPECT_EQ(log.dropped, dropped += 6) << why;
    EXPECT_EQ(log.why, "a datagram could not be sent");
    const std::string all = book.text();
    EXPECT_THAT(all, HasSubstr(to + why));
    EXPECT_EQ(all.find(to + why), all.rfind(to + why)) << "once";
    send_refused = 0;
    port->write(as_bytes("two"));
    EXPECT_EQ(got(), "two");
  }
  EXPECT_EQ(log.events, "up ");
  EXPECT_FALSE(port->congested());
}

TEST_F(UdpQueueTest, AReceiveThatFailsLosesNothing) {
  make_sending();
  for (const int error : {EINTR, ECONNREFUSED, EAGAIN, ENOMEM, EIO}) {
    log.data.clear();
    peer.send_to(number, "one");
    EXPECT_TRUE(test::while_refused({{SYS_recvmsg, error}}, [&] {
      for (int n = 0; n < 10; ++n) turn();
      port->read_pending();
    }));
    EXPECT_EQ(log.data, "");
    settle(loop);
    EXPECT_EQ(log.data, "one") << error;
  }
  EXPECT_EQ(log.events, "up ");
}

TEST_F(UdpQueueTest, AFirstDatagramThatCannotBeLookedAtOpensTheLineLater) {
  make_listening();
  peer.send_to(number, "one");
  EXPECT_TRUE(test::while_refused({{SYS_recvfrom, ENOMEM}}, [&] {
    for (int n = 0; n < 10; ++n) turn();
  }));
  EXPECT_EQ(log.events, "");
  settle(loop);
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.data, "one");
}

TEST_F(UdpQueueTest, WhereLossesCannotBeCountedNoneAreTold) {
  make_sending();
  EXPECT_TRUE(test::while_refused({{SYS_getsockopt, ENOPROTOOPT}}, [&] { port->close(); }));
  EXPECT_THAT(book.text(), Not(HasSubstr("lost")));
  EXPECT_EQ(log.why, "");
}

TEST_F(UdpQueueTest, WhyItCannotReceiveIsTold) {
  const std::pair<test::RefusedCall, std::string> cases[] = {
      {{SYS_socket, EMFILE}, "Too many open files"},
      {{SYS_bind, EACCES}, "Permission denied"},
      {{SYS_bind, EADDRINUSE}, "Address already in use"},
      {{SYS_bind, EADDRNOTAVAIL}, "Cannot assign requested address"}};
  const Result<PortSpec> options = parse_port("udp-listen:127.0.0.1:2112");
  ASSERT_TRUE(options.has_value());
  for (const auto& [call, why] : cases) {
    UdpPort other(PortContext{&loop, book.log()}, options->common(), *options->get<UdpOptions>());
    other.listen(log);
    EXPECT_TRUE(test::while_refused({call}, [&, why = why] {
      EXPECT_EQ(other.prepare().error(),
                make_error(Errc::usage, "cannot receive on 127.0.0.1:2112: " + why +
                                            "; choose another recv_ip or recv_port"));
    }));
    other.close();
  }
  EXPECT_THAT(book.text(), Not(HasSubstr("receiving datagrams")));
}

TEST_F(UdpQueueTest, AnOptionOfTheSocketThatIsRefusedCostsNothing) {
  EXPECT_TRUE(test::while_refused({{SYS_setsockopt, ENOPROTOOPT}}, [&] { make_sending(); }));
  peer.send_to(number, "one");
  settle(loop);
  EXPECT_EQ(log.data, "one");
}

// IPv4's are the addresses of a system without IPv6, and not a way around a port that is taken.
TEST_F(UdpQueueTest, TheWildcardIsIpv4WhereThereIsNoIpv6AndNotWhereItsPortIsTaken) {
  const test::RefusedCall no_ipv6{SYS_socket, EAFNOSUPPORT,
                                  test::RefusedCall::Argument{0, 0xffffffff, AF_INET6}};
  EXPECT_TRUE(test::while_refused({no_ipv6}, [&] { make("udp-listen:*:0"); }));
  EXPECT_THAT(book.text(), HasSubstr("receiving datagrams on 0.0.0.0:"));
  const SocketAddress any = *numeric_address("::", 0);
  const UniqueFd taken(::socket(AF_INET6, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  if (!taken || ::setsockopt(taken.get(), IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on) != 0 ||
      ::bind(taken.get(), any.get(), any.size) != 0) {
    GTEST_SKIP() << "no IPv6 here";
  }
  const std::string spelled = "udp-listen:*:" + std::to_string(local_address(taken.get()).port());
  const Result<PortSpec> options = parse_port(spelled);
  ASSERT_TRUE(options.has_value());
  UdpPort other(PortContext{&loop, book.log()}, options->common(), *options->get<UdpOptions>());
  const Result<void> prepared = other.prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_THAT(prepared.error().message, HasSubstr("Address already in use"));
}

}  // namespace
}  // namespace porttape
