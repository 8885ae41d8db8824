#include "libport/net/socket_address.hpp"

#include <cstring>
#include <netinet/in.h>
#include <string>
#include <sys/un.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

SocketAddress at(const std::string& host, std::uint16_t port) {
  const auto address = numeric_address(host, port);
  EXPECT_TRUE(address.has_value()) << host;
  return address.value_or(SocketAddress());
}

TEST(SocketAddress, IsWrittenAsUsersWriteIt) {
  const SocketAddress four = at("127.0.0.1", 2112);
  EXPECT_EQ(four.family(), AF_INET);
  EXPECT_EQ(four.host(), "127.0.0.1");
  EXPECT_EQ(four.port(), 2112);
  EXPECT_EQ(four.text(), "127.0.0.1:2112");
  const SocketAddress six = at("::1", 65535);
  EXPECT_EQ(six.family(), AF_INET6);
  EXPECT_EQ(six.host(), "::1");
  EXPECT_EQ(six.port(), 65535);
  EXPECT_EQ(six.text(), "[::1]:65535");
}

TEST(SocketAddress, OfAUnixSocketIsItsPath) {
  const Result<SocketAddress> address = unix_address("/run/laser");
  ASSERT_TRUE(address.has_value());
  EXPECT_EQ(address->family(), AF_UNIX);
  EXPECT_EQ(address->text(), "/run/laser");
  EXPECT_EQ(address->host(), "?");
  EXPECT_EQ(address->port(), 0);
}

TEST(SocketAddress, AUnixPathMayHave107Bytes) {
  const std::string longest(107, 'x');
  const Result<SocketAddress> fits = unix_address(longest);
  ASSERT_TRUE(fits.has_value());
  EXPECT_EQ(fits->text(), longest);
  EXPECT_EQ(fits->size, sizeof(sockaddr_un));
  const std::string path(108, 'x');
  const Result<SocketAddress> refused = unix_address(path);
  ASSERT_FALSE(refused.has_value());
  EXPECT_EQ(refused.error().code, Errc::usage);
  EXPECT_EQ(refused.error().message,
            "option 'path': '" + path + "' is 108 bytes long; accepted: at most 107");
}

TEST(SocketAddress, HasTheSizeOfItsKind) {
  EXPECT_EQ(at("127.0.0.1", 1).size, sizeof(sockaddr_in));
  EXPECT_EQ(at("::1", 1).size, sizeof(sockaddr_in6));
  EXPECT_EQ(unix_address("/x")->size, offsetof(sockaddr_un, sun_path) + 3);
}

TEST(SocketAddress, ANumberNeedsNoNameServerAndANameIsNone) {
  EXPECT_FALSE(numeric_address("localhost", 1).has_value());
  EXPECT_FALSE(numeric_address("256.0.0.1", 1).has_value());
  EXPECT_FALSE(numeric_address("127.0.0.1:5", 1).has_value());
}

TEST(SocketAddress, IsTheSameByHostAndPortAlone) {
  EXPECT_TRUE(same_host_and_port(at("127.0.0.1", 7), at("127.0.0.1", 7)));
  EXPECT_FALSE(same_host_and_port(at("127.0.0.1", 7), at("127.0.0.1", 8)));
  EXPECT_FALSE(same_host_and_port(at("127.0.0.1", 7), at("127.0.0.2", 7)));
  EXPECT_TRUE(same_host_and_port(at("::1", 7), at("::1", 7)));
  EXPECT_FALSE(same_host_and_port(at("::1", 7), at("::2", 7)));
  EXPECT_FALSE(same_host_and_port(at("::1", 7), at("::1", 8)));
  EXPECT_FALSE(same_host_and_port(at("127.0.0.1", 7), at("::1", 7)));
  EXPECT_FALSE(same_host_and_port(at("::", 7), at("0.0.0.0", 7)));
  EXPECT_FALSE(same_host_and_port(*unix_address("/x"), *unix_address("/x"))) << "of the internet alone";
}

TEST(SocketAddress, TheFlowAndTheScopeOfIpv6AreNoOtherPeer) {
  SocketAddress scoped = at("::1", 7);
  sockaddr_in6 six{};
  std::memcpy(&six, &scoped.storage, sizeof six);
  six.sin6_flowinfo = 5;
  six.sin6_scope_id = 3;
  std::memcpy(&scoped.storage, &six, sizeof six);
  EXPECT_TRUE(same_host_and_port(scoped, at("::1", 7)));
}

TEST(SocketAddress, ANameHasEachAddressOnce) {
  const auto addresses = resolve("127.0.0.1", 20000);
  ASSERT_TRUE(addresses.has_value());
  ASSERT_EQ(addresses->size(), 1U);
  EXPECT_EQ(addresses->front().text(), "127.0.0.1:20000");
}

TEST(SocketAddress, ANameThatDoesNotResolveIsTold) {
  const auto addresses = resolve("no such host", 1);
  ASSERT_FALSE(addresses.has_value());
  EXPECT_EQ(addresses.error().code, Errc::device_missing);
  EXPECT_THAT(addresses.error().message, testing::StartsWith("the name 'no such host' does not resolve ("));
  EXPECT_THAT(addresses.error().message, testing::EndsWith(")"));
}

TEST(SocketAddress, AllAddressesAreIpv6sFirst) {
  const auto addresses = any_addresses(2112);
  ASSERT_EQ(addresses.size(), 2U);
  EXPECT_EQ(addresses[0].text(), "[::]:2112");
  EXPECT_EQ(addresses[1].text(), "0.0.0.0:2112");
}

TEST(SocketAddress, ThisMachineReachesAWildcardByItsLoopback) {
  EXPECT_EQ(place_bound_at(at("0.0.0.0", 7)).text(), "127.0.0.1:7");
  EXPECT_EQ(place_bound_at(at("::", 8)).text(), "127.0.0.1:8");
  EXPECT_EQ(place_bound_at(at("127.0.0.2", 9)).text(), "127.0.0.2:9");
  EXPECT_EQ(place_bound_at(at("::1", 10)).text(), "[::1]:10");
}

TEST(SocketAddress, OfASocketIsItsOwnAndItsPeers) {
  const test::Socket one = test::Socket::datagrams();
  const test::Socket other = test::Socket::datagrams();
  const SocketAddress to = at("127.0.0.1", other.port());
  ASSERT_EQ(::connect(one.fd(), to.get(), to.size), 0);
  EXPECT_EQ(local_address(one.fd()).port(), one.port());
  EXPECT_EQ(peer_address(one.fd()).text(), to.text());
  EXPECT_EQ(peer_address(other.fd()).port(), 0) << "it has none";
}

}  // namespace
}  // namespace porttape
