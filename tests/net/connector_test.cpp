#include "libport/net/connector.hpp"

#include <cerrno>
#include <chrono>
#include <cstring>
#include <fcntl.h>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/net/tcp_peer.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::Socket;

class ConnectorTest : public testing::Test {
 protected:
  void make(Nanos limit = seconds(10)) {
    connector = std::make_unique<Connector>(loop, limit, [this](Result<UniqueFd> came) {
      result.emplace(std::move(came));
      connector.reset();  // which the callback may
    });
  }
  void until_called() {
    while (!result) loop.run_one();
  }

  ManualClock clock;
  Loop loop{clock};
  std::optional<Result<UniqueFd>> result;
  std::unique_ptr<Connector> connector;
};

TEST_F(ConnectorTest, CallsFromTheLoopWithTheConnectedSocket) {
  const Socket server = Socket::listening();
  make();
  connector->to_host("127.0.0.1", server.port());
  EXPECT_FALSE(result) << "not from within the call";
  (void)let_pass(loop, clock, milliseconds(1));
  until_called();
  ASSERT_TRUE(*result);
  const int fd = (*result)->get();
  EXPECT_EQ(peer_address(fd).port(), server.port());
  EXPECT_NE(::fcntl(fd, F_GETFL) & O_NONBLOCK, 0);
  EXPECT_NE(::fcntl(fd, F_GETFD) & FD_CLOEXEC, 0);
}

TEST_F(ConnectorTest, ARefusalSaysWhereAndWhatToLookAt) {
  const Socket deaf = Socket::bound();
  make();
  connector->to_host("127.0.0.1", deaf.port());
  (void)let_pass(loop, clock, milliseconds(1));
  until_called();
  ASSERT_FALSE(*result);
  EXPECT_EQ(result->error().code, Errc::device_missing);
  EXPECT_EQ(result->error().message,
            "cannot connect to 127.0.0.1:" + std::to_string(deaf.port()) +
                ": Connection refused; nobody listens there; is the device switched on and the port right?");
}

TEST_F(ConnectorTest, AnAddressIsNamedByItself) {
  const Socket deaf = Socket::bound();
  make();
  connector->to_address(*numeric_address("127.0.0.1", deaf.port()));
  (void)let_pass(loop, clock, milliseconds(1));
  until_called();
  ASSERT_FALSE(*result);
  EXPECT_EQ(result->error().message.find("cannot connect to 127.0.0.1:" + std::to_string(deaf.port()) + ": "),
            0U);
}

TEST_F(ConnectorTest, OneThatDoesNotAnswerIsGivenUpAfterTheLimit) {
  const Socket full = Socket::listening(0);
  const Socket first = Socket::connect_to(full.port());  // the backlog: the kernel answers nobody else
  make(seconds(3));
  connector->to_host("127.0.0.1", full.port());
  EXPECT_FALSE(let_pass(loop, clock, milliseconds(2999), [this] { return result.has_value(); }));
  EXPECT_TRUE(let_pass(loop, clock, milliseconds(1), [this] { return result.has_value(); }));
  ASSERT_TRUE(result && !*result);
  EXPECT_EQ(result->error().message,
            "cannot connect to 127.0.0.1:" + std::to_string(full.port()) +
                ": Connection timed out; it does not answer; check the address and firewalls");
}

TEST_F(ConnectorTest, ASocketThatIsNotThereIsOneToCheck) {
  SocketAddress address;
  sockaddr_un nowhere{};
  nowhere.sun_family = AF_UNIX;
  std::string_view("/nonexistent/socket").copy(nowhere.sun_path, sizeof nowhere.sun_path - 1);
  std::memcpy(&address.storage, &nowhere, sizeof nowhere);
  address.size = sizeof nowhere;
  make();
  connector->to_address(address);
  (void)let_pass(loop, clock, milliseconds(1));
  until_called();
  ASSERT_FALSE(*result);
  EXPECT_NE(result->error().message.find("No such file or directory; check the address"), std::string::npos)
      << result->error().message;
}

TEST_F(ConnectorTest, OneThatIsDestroyedCallsNobody) {
  const Socket server = Socket::listening();
  make();
  connector->to_host("127.0.0.1", server.port());
  connector.reset();
  (void)let_pass(loop, clock, seconds(20));
  EXPECT_FALSE(result);
}

// Of a name with several addresses each is told with what it answered.
TEST_F(ConnectorTest, ANameThatRefusesTellsOfEachOfItsAddresses) {
  const Socket deaf = Socket::bound();
  const auto addresses = resolve("localhost", deaf.port());
  ASSERT_TRUE(addresses.has_value());
  make();
  connector->to_host("localhost", deaf.port());
  until_called();
  ASSERT_FALSE(*result);
  const std::string message = result->error().message;
  EXPECT_EQ(message.find("cannot connect to localhost:" + std::to_string(deaf.port()) + ": "), 0U) << message;
  std::size_t at = 0;
  for (const SocketAddress& address : *addresses) {
    const std::string told = addresses->size() > 1 ? address.text() + ": " : ": Connection refused";
    const std::size_t found = message.find(told, at);
    ASSERT_NE(found, std::string::npos) << told << " in " << message;
    at = found + told.size();
  }
}

TEST_F(ConnectorTest, AnAddressThatThisMachineCannotCallIsOneToCheck) {
  make();
  connector->to_address(*numeric_address("255.255.255.255", 9));
  (void)let_pass(loop, clock, milliseconds(1));
  until_called();
  ASSERT_FALSE(*result);
  EXPECT_EQ(result->error().message.find("cannot connect to 255.255.255.255:9: "), 0U);
  EXPECT_EQ(result->error().code, Errc::device_missing);
}

TEST_F(ConnectorTest, ANumberIsLookedUpNowhere) {
  const Socket server = Socket::listening();
  for (const std::string host : {"127.0.0.1", "::1"}) {
    make();
    connector->to_host(host, server.port());
    EXPECT_FALSE(loop.has_jobs()) << host;
    connector.reset();
  }
}

TEST_F(ConnectorTest, WhyItCannotConnectIsToldWithWhatToDo) {
  const std::pair<test::RefusedCall, std::string> cases[] = {
      {{SYS_socket, EMFILE}, "Too many open files; check the address"},
      {{SYS_socket, EAFNOSUPPORT}, "Address family not supported by protocol; check the address"},
      {{SYS_connect, ECONNREFUSED},
       "Connection refused; nobody listens there; is the device switched on and the port right?"},
      {{SYS_connect, ENETUNREACH}, "Network is unreachable; check the network and the address"},
      {{SYS_connect, EHOSTUNREACH}, "No route to host; check the network and the address"},
      {{SYS_connect, ETIMEDOUT}, "Connection timed out; it does not answer; check the address and firewalls"},
      {{SYS_connect, EPERM}, "Operation not permitted; check the address"},
      {{SYS_connect, EAGAIN}, "Resource temporarily unavailable; check the address"}};
  for (const auto& [call, why] : cases) {
    result.reset();
    make();
    connector->to_host("127.0.0.1", 2112);
    EXPECT_TRUE(test::while_refused({call}, [&] { (void)let_pass(loop, clock, milliseconds(1)); }));
    ASSERT_TRUE(result) << why;
    ASSERT_FALSE(*result) << why;
    EXPECT_EQ(result->error(), make_error(Errc::device_missing, "cannot connect to 127.0.0.1:2112: " + why));
    EXPECT_FALSE(loop.next_timer()) << "it is over";
  }
}

// What the kernel knows of the other end of a connection on this machine.
TEST(TcpPeer, IsReadingUntilItHasClosed) {
  const Socket server = Socket::listening();
  Socket client = Socket::connect_to(server.port());
  const Socket accepted = server.accept();
  EXPECT_EQ(tcp_peer_state(accepted.fd()), PeerState::reading);
  EXPECT_EQ(tcp_peer_state(client.fd()), PeerState::reading);
  client.end_sending();
  EXPECT_EQ(tcp_peer_state(accepted.fd()), PeerState::reading) << "it has ended one direction";
  client.close();
  EXPECT_EQ(tcp_peer_state(accepted.fd()), PeerState::gone);
}

TEST(TcpPeer, OfIpv6IsKnownTheSameWay) {
  const SocketAddress any = *numeric_address("::1", 0);
  const UniqueFd server(::socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0));
  ASSERT_EQ(::bind(server.get(), any.get(), any.size), 0);
  ASSERT_EQ(::listen(server.get(), 1), 0);
  Socket client = Socket::connect_to(local_address(server.get()));
  const UniqueFd accepted(::accept4(server.get(), nullptr, nullptr, SOCK_CLOEXEC));
  EXPECT_EQ(tcp_peer_state(accepted.get()), PeerState::reading);
  client.close();
  EXPECT_EQ(tcp_peer_state(accepted.get()), PeerState::gone);
}

TEST(TcpPeer, IsUnknownOfWhatIsNoConnection) {
  int ends[2];
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
  const UniqueFd one(ends[0]);
  const UniqueFd other(ends[1]);
  EXPECT_EQ(tcp_peer_state(one.get()), PeerState::unknown);
  EXPECT_EQ(tcp_peer_state(Socket::bound().fd()), PeerState::unknown) << "it has no peer";
}

// No TCP socket of this machine has the other end of a datagram's.
TEST(TcpPeer, IsRemoteWhereNoSocketOfThisMachineHasTheOtherEnd) {
  for (const char* const host : {"127.0.0.1", "::1"}) {
    const SocketAddress there = *numeric_address(host, 9);
    const UniqueFd fd(::socket(there.family(), SOCK_DGRAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(::connect(fd.get(), there.get(), there.size), 0) << host;
    EXPECT_EQ(tcp_peer_state(fd.get()), PeerState::remote) << host;
  }
}

TEST(TcpPeer, IsUnknownWhereTheKernelCannotBeAskedOrDoesNotAnswer) {
  const Socket server = Socket::listening();
  const Socket client = Socket::connect_to(server.port());
  const Socket accepted = server.accept();
  const test::RefusedCall::Argument netlink{0, 0xffffffff, AF_NETLINK};
  for (const test::RefusedCall& call :
       {test::RefusedCall{SYS_socket, EAFNOSUPPORT, netlink}, test::RefusedCall{SYS_socket, EMFILE, netlink},
        test::RefusedCall{SYS_sendto, EPERM}, test::RefusedCall{SYS_sendto, 0},
        test::RefusedCall{SYS_recvfrom, EAGAIN}, test::RefusedCall{SYS_recvfrom, 0},
        test::RefusedCall{SYS_getsockname, EBADF}, test::RefusedCall{SYS_getpeername, ENOTCONN}}) {
    EXPECT_TRUE(test::while_refused(
        {call}, [&] { EXPECT_EQ(tcp_peer_state(accepted.fd()), PeerState::unknown) << call.number; }));
    EXPECT_EQ(tcp_peer_state(accepted.fd()), PeerState::reading);
  }
}

}  // namespace
}  // namespace porttape
