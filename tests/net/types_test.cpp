// What the options of socket ports become.

#include "libport/net/types.hpp"

#include <cstdint>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "libport/net/tcp_port.hpp"
#include "libport/net/udp_port.hpp"
#include "libport/net/unix_port.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using Claim = PortType::Claim;

template <class Options>
Options options(const std::string& spelled) {
  const Result<PortSpec> spec = parse_port(spelled);
  if (!spec) {
    ADD_FAILURE() << spec.error().message;
    return {};
  }
  return *spec->get<Options>();
}

std::string refused(const std::string& spelled) {
  const Result<PortSpec> spec = parse_port(spelled);
  if (spec) return "nothing is wrong";
  EXPECT_EQ(spec.error().code, Errc::usage);
  return spec.error().message;
}

std::vector<Claim> claims(const std::string& spelled) {
  const Result<PortSpec> spec = parse_port(spelled);
  return spec ? spec->type().claims(*spec) : std::vector<Claim>{{"wrong", spec.error().message}};
}

TEST(TcpOptionsTest, HaveFlexiportsDefaults) {
  const auto tcp = options<TcpOptions>("type=tcp");
  EXPECT_EQ(tcp.host, "127.0.0.1");
  EXPECT_EQ(tcp.port, 20000);
  EXPECT_FALSE(tcp.stream.listen);
  EXPECT_FALSE(tcp.stream.wait);
}

TEST(StreamOptionsTest, ListenIsAFlagThatIsSpelledBothWays) {
  EXPECT_TRUE(options<TcpOptions>("tcp:127.0.0.1:2112,listen").stream.listen);
  EXPECT_TRUE(options<TcpOptions>("type=tcp,listen").stream.listen);
  EXPECT_TRUE(options<UnixOptions>("unix:/run/x,listen").stream.listen);
  EXPECT_TRUE(options<UdpOptions>("udp:127.0.0.1:9,recv_port=0,listen").listen);
}

TEST(StreamOptionsTest, AFlagIsOnOrOff) {
  for (const std::string port : {"tcp:127.0.0.1:2112", "unix:/run/x", "udp:127.0.0.1:9"}) {
    EXPECT_THAT(refused(port + ",listen=maybe"),
                HasSubstr("option 'listen': 'maybe' is not valid; accepted: on, off"));
    if (port.starts_with("udp")) continue;  // its peer need not be there
    EXPECT_THAT(refused(port + ",wait=maybe"),
                HasSubstr("option 'wait': 'maybe' is not valid; accepted: on, off"));
  }
  EXPECT_TRUE(options<TcpOptions>("tcp:127.0.0.1:2112,listen=on").stream.listen);
  EXPECT_FALSE(options<TcpOptions>("tcp:127.0.0.1:2112,listen=off").stream.listen);
}

TEST(TcpOptionsTest, AreEachItsOwn) {
  const auto tcp = options<TcpOptions>("tcp:laser.example:2112,wait");
  EXPECT_EQ(tcp.host, "laser.example");
  EXPECT_EQ(tcp.port, 2112);
  EXPECT_TRUE(tcp.stream.wait);
  EXPECT_FALSE(tcp.stream.listen);
  const auto listening = options<TcpOptions>("tcp-listen:*:0");
  EXPECT_EQ(listening.host, "*");
  EXPECT_EQ(listening.port, 0);
  EXPECT_TRUE(listening.stream.listen);
  EXPECT_EQ(listening.stream.most_connections, 256U);
  EXPECT_EQ(options<TcpOptions>("tcp-listen:*:0,max-connections=3").stream.most_connections, 3U);
}

TEST(StreamOptionsTest, AnEmptyHostIsNotAllOfThisMachinesAddresses) {
  for (const std::string port : {"type=tcp,ip=", "type=tcp,listen,port=0,ip=", "tcp-listen:,port=0,ip="})
    EXPECT_THAT(refused(port), HasSubstr("option 'ip': '' is not valid; accepted: a name or an address"));
  for (const std::string port : {"type=udp,listen,recv_ip=,recv_port=0", "udp:127.0.0.1:9,recv_ip="})
    EXPECT_THAT(refused(port), HasSubstr("option 'recv_ip': '' is not valid"));
  EXPECT_THAT(refused("type=udp,dest_ip="), HasSubstr("option 'dest_ip': '' is not valid"));
}

TEST(TcpOptionsTest, AFreePortIsForListeningAlone) {
  EXPECT_EQ(
      refused("tcp:127.0.0.1:0"),
      "port 'tcp:127.0.0.1:0': option 'port': '0' is not valid; accepted: a whole number from 1 to 65535");
  EXPECT_THAT(refused("tcp:127.0.0.1:65536"), HasSubstr("65536"));
  EXPECT_EQ(options<TcpOptions>("tcp:127.0.0.1:65535").port, 65535);
  EXPECT_EQ(options<TcpOptions>("tcp:127.0.0.1:1").port, 1);
}

TEST(TcpOptionsTest, AnAddressThatIsListenedOnIsClaimed) {
  EXPECT_THAT(claims("tcp-listen:127.0.0.1:2112"), ElementsAre(Claim("TCP port", "127.0.0.1:2112")));
  EXPECT_THAT(claims("tcp-listen:127.0.0.1:0"), IsEmpty());
  EXPECT_THAT(claims("tcp:127.0.0.1:2112"), IsEmpty());
}

TEST(UdpOptionsTest, HaveFlexiportsDefaults) {
  const auto udp = options<UdpOptions>("type=udp");
  EXPECT_EQ(udp.to_host, "127.0.0.1");
  EXPECT_EQ(udp.to_port, 20000);
  EXPECT_EQ(udp.own_host, "*");
  EXPECT_EQ(udp.own_port, 20000);
  EXPECT_FALSE(udp.listen);
  EXPECT_EQ(udp.from, UdpOptions::From::as_usual);
}

TEST(UdpOptionsTest, AreEachItsOwn) {
  const auto udp = options<UdpOptions>("udp:10.0.0.1:1,recv_ip=10.0.0.2,recv_port=2,from=peer");
  EXPECT_EQ(udp.to_host, "10.0.0.1");
  EXPECT_EQ(udp.to_port, 1);
  EXPECT_EQ(udp.own_host, "10.0.0.2");
  EXPECT_EQ(udp.own_port, 2);
  EXPECT_EQ(udp.from, UdpOptions::From::peer);
  EXPECT_EQ(options<UdpOptions>("udp:10.0.0.1:1,from=any").from, UdpOptions::From::any);
  EXPECT_THAT(refused("udp:10.0.0.1:1,from=me"), HasSubstr("'from'"));
  EXPECT_THAT(refused("udp:10.0.0.1:0"), HasSubstr("'dest_port'"));
}

TEST(UdpOptionsTest, ListenOnTheLoopbackUnlessAnotherAddressIsGiven) {
  EXPECT_EQ(options<UdpOptions>("type=udp,listen").own_host, "127.0.0.1");
  EXPECT_EQ(options<UdpOptions>("udp-listen:*:5").own_host, "*");
  EXPECT_TRUE(options<UdpOptions>("udp-listen:*:5").listen);
}

TEST(UdpOptionsTest, TheirOwnAddressIsClaimed) {
  EXPECT_THAT(claims("udp:10.0.0.1:1,recv_ip=10.0.0.2,recv_port=2"),
              ElementsAre(Claim("UDP port", "10.0.0.2:2")));
  EXPECT_THAT(claims("udp:10.0.0.1:1,recv_port=0"), IsEmpty());
}

TEST(UnixOptionsTest, AreEachItsOwn) {
  const auto plain = options<UnixOptions>("unix:/run/laser");
  EXPECT_EQ(plain.path, "/run/laser");
  EXPECT_EQ(plain.mode, 0600U);
  EXPECT_FALSE(plain.stream.listen);
  EXPECT_FALSE(plain.stream.wait);
  const auto listening = options<UnixOptions>("unix-listen:/run/laser,mode=0777,wait");
  EXPECT_EQ(listening.mode, 0777U);
  EXPECT_TRUE(listening.stream.listen);
  EXPECT_EQ(listening.stream.most_connections, 256U);
  EXPECT_EQ(options<TcpOptions>("tcp-listen:*:0,max-connections=3").stream.most_connections, 3U);
  EXPECT_TRUE(listening.stream.wait);
}

TEST(UnixOptionsTest, NeedAPathThatFits) {
  EXPECT_EQ(refused("type=unix"),
            "port 'type=unix': option 'path' is missing; accepted: the path of a socket");
  EXPECT_THAT(refused("unix:/" + std::string(107, 'x')),
              HasSubstr("is 108 bytes long; accepted: at most 107"));
  EXPECT_EQ(options<UnixOptions>("unix:/" + std::string(106, 'x')).path.size(), 107U);
  EXPECT_THAT(refused("unix-listen:/x,mode=01000"), HasSubstr("'mode'"));
}

TEST(UnixOptionsTest, ASocketThatIsListenedOnIsClaimed) {
  EXPECT_THAT(claims("unix-listen:/run/laser"), ElementsAre(Claim("socket", "/run/laser")));
  EXPECT_THAT(claims("unix:/run/laser"), IsEmpty());
}

}  // namespace
}  // namespace porttape
