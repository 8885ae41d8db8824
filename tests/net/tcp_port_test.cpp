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

}  // namespace
}  // namespace porttape
