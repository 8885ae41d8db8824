// What a TCP port asks of the kernel, and what it says.

#include "libport/net/tcp_port.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>

#include <gmock/gmock.h>

#include "tests/net/stream_port_rig.hpp"
#include "tests/support/refused_calls.hpp"

namespace {

// Of each socket that is made ready: what was set, by level and option.
std::map<std::pair<int, int>, int> options_set;

}  // namespace

// In the place of the C library's, for this program.
// NOLINTNEXTLINE(readability-inconsistent-declaration-parameter-name)
extern "C" int setsockopt(int fd, int level, int option, const void* value, socklen_t size) noexcept {
  if (size == sizeof(int)) {
    int number = 0;
    std::memcpy(&number, value, sizeof number);
    options_set[{level, option}] = number;
  }
  return static_cast<int>(::syscall(SYS_setsockopt, fd, level, option, value, size));
}

namespace porttape {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::StartsWith;

class TcpPortTest : public StreamPortRig {
 protected:
  TcpPortTest() { options_set.clear(); }
  Error refused(const std::string& spec) {
    make(spec);
    const Result<void> prepared = port->prepare();
    if (!prepared) return prepared.error();
    ADD_FAILURE() << spec << " was taken";
    return {};
  }
};

TEST_F(TcpPortTest, SendsAtOnceAndNoticesAPeerThatVanishedInAMinuteAndAHalf) {
  make_connecting();
  port->open();
  const Socket device = accepted();
  EXPECT_EQ((options_set[{IPPROTO_TCP, TCP_NODELAY}]), 1);
  EXPECT_EQ((options_set[{SOL_SOCKET, SO_KEEPALIVE}]), 1);
  EXPECT_EQ((options_set[{IPPROTO_TCP, TCP_KEEPIDLE}]), 60);
  EXPECT_EQ((options_set[{IPPROTO_TCP, TCP_KEEPINTVL}]), 10);
  EXPECT_EQ((options_set[{IPPROTO_TCP, TCP_KEEPCNT}]), 3);
}

TEST_F(TcpPortTest, AListenerCanHaveItsAddressAgainAtOnce) {
  make_listening();
  EXPECT_EQ((options_set[{SOL_SOCKET, SO_REUSEADDR}]), 1);
  EXPECT_FALSE(options_set.contains({IPPROTO_IPV6, IPV6_V6ONLY})) << "it is IPv4";
}

TEST_F(TcpPortTest, TheWildcardTakesIpv4OnItsIpv6Socket) {
  make("tcp-listen:*:0");
  if (!port->prepare()) GTEST_SKIP() << "no IPv6 here";
  if (!book.text().empty() && book.text().find("[::]") == std::string::npos) GTEST_SKIP() << "no IPv6 here";
  EXPECT_EQ((options_set.at({IPPROTO_IPV6, IPV6_V6ONLY})), 0);
  EXPECT_EQ(port->place().host, "127.0.0.1");
}

TEST_F(TcpPortTest, AnAddressInUseIsToldWithWhatToDo) {
  const std::string taken = std::to_string(server.port());
  const Error error = refused("tcp-listen:127.0.0.1:" + taken);
  EXPECT_EQ(error.code, Errc::usage);
  EXPECT_EQ(error.message,
            "cannot listen on 127.0.0.1:" + taken +
                ": Address already in use; another program listens there; choose another port");
}

TEST_F(TcpPortTest, AnAddressOfAnotherMachineIsToldWithWhatToDo) {
  EXPECT_EQ(refused("tcp-listen:192.0.2.1:2112").message,
            "cannot listen on 192.0.2.1:2112: Cannot assign requested address; this machine has no such "
            "address");
}

TEST_F(TcpPortTest, ANameThatDoesNotResolveIsTheOptionsFault) {
  const Error error = refused("tcp-listen:no.such.host.invalid:2112");
  EXPECT_EQ(error.code, Errc::usage);
  EXPECT_THAT(error.message, StartsWith("option 'ip': the name 'no.such.host.invalid' does not resolve"));
}

TEST_F(TcpPortTest, IsCalledAsItIsSpelled) {
  make("tcp:laser.example:2112");
  EXPECT_EQ(port->name(), "tcp:laser.example:2112");
  EXPECT_EQ(port->place().host, "laser.example");
  EXPECT_EQ(port->place().port, 2112);
  make_listening();
  EXPECT_THAT(port->name(), StartsWith("tcp-listen:127.0.0.1:"));
  EXPECT_THAT(port->name(), EndsWith(":" + std::to_string(number)));
  EXPECT_EQ(port->place().text(), "127.0.0.1:" + std::to_string(number));
  EXPECT_THAT(book.text(), HasSubstr("listening on 127.0.0.1:" + std::to_string(number)));
}

TEST_F(TcpPortTest, WhyItCannotListenIsToldWithWhatToDo) {
  const std::string taken = "Address already in use; another program listens there; choose another port";
  const std::pair<test::RefusedCall, std::string> cases[] = {
      {{SYS_socket, EMFILE}, "Too many open files; check the address"},
      {{SYS_socket, EAFNOSUPPORT}, "Address family not supported by protocol; check the address"},
      {{SYS_bind, EACCES},
       "Permission denied; ports below 1024 need CAP_NET_BIND_SERVICE; choose another port"},
      {{SYS_bind, EADDRNOTAVAIL}, "Cannot assign requested address; this machine has no such address"},
      {{SYS_bind, EADDRINUSE}, taken},
      {{SYS_listen, EADDRINUSE}, taken},
      {{SYS_bind, ENOMEM}, "Cannot allocate memory; check the address"}};
  for (const auto& [call, why] : cases) {
    EXPECT_TRUE(test::while_refused({call}, [&, why = why] {
      EXPECT_EQ(refused("tcp-listen:127.0.0.1:2112"),
                make_error(Errc::usage, "cannot listen on 127.0.0.1:2112: " + why));
    }));
  }
  EXPECT_EQ(book.text(), "") << "it listens nowhere";
}

// IPv4's are the addresses of a system without IPv6, and not a way around a port that is taken.
TEST_F(TcpPortTest, TheWildcardIsIpv4WhereThereIsNoIpv6AndNotWhereItsPortIsTaken) {
  const test::RefusedCall no_ipv6{SYS_socket, EAFNOSUPPORT,
                                  test::RefusedCall::Argument{0, 0xffffffff, AF_INET6}};
  EXPECT_TRUE(test::while_refused({no_ipv6}, [&] {
    make("tcp-listen:*:0");
    EXPECT_NE(test::prepare_any(*port), 0);
  }));
  EXPECT_THAT(book.text(), HasSubstr("listening on 0.0.0.0:"));
  const SocketAddress any = *numeric_address("::", 0);
  const UniqueFd other(::socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  if (!other || ::setsockopt(other.get(), IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on) != 0 ||
      ::bind(other.get(), any.get(), any.size) != 0 || ::listen(other.get(), 1) != 0) {
    GTEST_SKIP() << "no IPv6 here";
  }
  const std::string taken = std::to_string(local_address(other.get()).port());
  EXPECT_THAT(refused("tcp-listen:*:" + taken).message, HasSubstr("Address already in use"));
}

TEST_F(TcpPortTest, AnOptionThatTheKernelDoesNotTakeCostsNoConnection) {
  make_connecting();
  EXPECT_TRUE(test::while_refused({{SYS_setsockopt, ENOPROTOOPT}}, [&] {
    port->open();
    (void)accepted();
  }));
  EXPECT_THAT(log.events, StartsWith("up "));
}

}  // namespace
}  // namespace porttape
