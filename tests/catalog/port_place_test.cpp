// Where programs find the ports of each type.
#include "libport/port/port_place.hpp"

#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

class PortPlaces : public testing::Test {
 protected:
  // Of a port that is prepared; what it printed meanwhile is in `printed`.
  PortPlace place_of(const std::string& spelled, bool announces = false) {
    const Result<PortSpec> spec = parse_port(spelled);
    if (!spec) {
      ADD_FAILURE() << spec.error().message;
      return {};
    }
    PortContext context{.loop = &loop, .log = book.log()};
    context.announces = announces;
    Result<std::unique_ptr<Port>> made = make_port(context, *spec, "test");
    port = std::move(*made);
    port->listen(log);
    testing::internal::CaptureStdout();
    const Result<void> prepared = port->prepare();
    printed = testing::internal::GetCapturedStdout();
    EXPECT_TRUE(prepared.has_value()) << (prepared ? "" : prepared.error().message);
    return port->place();
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  PortLog log;
  std::unique_ptr<Port> port;
  std::string printed;
};

TEST_F(PortPlaces, AListeningSocketsHasTheNumberThatTheSystemChose) {
  for (const char* spelled : {"tcp-listen:127.0.0.1:0", "udp-listen:127.0.0.1:0", "tcp-listen:0"}) {
    const PortPlace place = place_of(spelled);
    EXPECT_EQ(place.host, "127.0.0.1") << spelled;
    EXPECT_GT(place.port, 0) << spelled;
    EXPECT_EQ(place.text(), "127.0.0.1:" + std::to_string(place.port));
    EXPECT_EQ(printed, "");
  }
}

TEST_F(PortPlaces, OneOnAllAddressesIsFoundOnThisMachine) {
  for (const char* spelled : {"tcp-listen:*:0", "udp-listen:*:0"}) {
    EXPECT_EQ(place_of(spelled).host, "127.0.0.1") << spelled;
  }
}

TEST_F(PortPlaces, WhatTheSystemChoseIsPrintedWhereThatIsWanted) {
  const PortPlace place = place_of("tcp-listen:127.0.0.1:0", true);
  EXPECT_EQ(printed, place.text() + "\n");
  const PortPlace tty = place_of("pty", true);
  EXPECT_EQ(printed, tty.path + "\n");
}

TEST_F(PortPlaces, FilesHaveTheirPath) {
  EXPECT_EQ(place_of("unix-listen:" + dir / "socket"), PortPlace{.path = dir / "socket"});
  const PortPlace linked = place_of("pty:" + dir / "port");
  EXPECT_EQ(linked.path, dir / "port");
  EXPECT_EQ(linked.node.substr(0, 9), "/dev/pts/");
  const PortPlace without_link = place_of("pty");
  EXPECT_EQ(without_link.path.substr(0, 9), "/dev/pts/");
  EXPECT_EQ(without_link.text(), without_link.path);
  EXPECT_EQ(without_link.node, without_link.path);
  EXPECT_EQ(printed, "");
}

TEST_F(PortPlaces, OneThatConnectsHasItsPeers) {
  EXPECT_EQ(place_of("tcp:192.0.2.7:502"), (PortPlace{.host = "192.0.2.7", .port = 502}));
  EXPECT_EQ(place_of("tcplog:192.0.2.7:502,file=" + dir / "tape"),
            (PortPlace{.host = "192.0.2.7", .port = 502}));
}

TEST(PortPlaceText, AnIPv6AddressHasBrackets) {
  EXPECT_EQ((PortPlace{.host = "::1", .port = 7}).text(), "[::1]:7");
}

}  // namespace
}  // namespace porttape
