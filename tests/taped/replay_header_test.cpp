// What the header of a tape's events file changes in its replay.

#include <cstddef>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_writer.hpp"
#include "libport/taped/replayed_device.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

class ReplayHeaderTest : public testing::Test {
 protected:
  // A tape of two blocks 400 µs apart, prepared to be played.
  ReplayPort& prepared(const TapeHeader& header) {
    auto writer = TapeWriter::create(tape, header, {.on_existing = OnExisting::overwrite, .sync = false});
    EXPECT_TRUE(writer.has_value());
    writer->read_block(tape_time_us(0), as_bytes("one "));
    writer->read_block(tape_time_us(400), as_bytes("two"));
    EXPECT_TRUE(writer->finish(tape_time_us(500)).has_value());
    ReplayOptions options;
    options.tape = tape;
    options.config.strictness = 0;
    port = std::make_unique<ReplayedDevice>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    EXPECT_TRUE(port->prepare().has_value());
    return *port;
  }

  test::TempDir dir;
  TapePaths tape = literal_tape(dir / "x.log");
  Loop loop;
  LogBook book;
  PortLog log;
  std::unique_ptr<ReplayPort> port;
};

TEST_F(ReplayHeaderTest, TheTransportSaysWhetherBlocksAreDatagrams) {
  EXPECT_TRUE(prepared({.device = "x", .driver = "y", .transport = Transport::datagram}).keeps_datagrams());
  EXPECT_FALSE(
      prepared({.device = "udp:h:1", .driver = "y", .transport = Transport::stream}).keeps_datagrams());
  EXPECT_TRUE(prepared({.device = "udp:h:1", .driver = "y"}).keeps_datagrams()) << "as on older tapes";
  EXPECT_FALSE(prepared({.device = "x", .driver = "y"}).keeps_datagrams());
}

// One arrival that a program read in two pieces is one arrival again.
TEST_F(ReplayHeaderTest, BlocksThatWereStampedWhenReadAreJoined) {
  prepared({.device = "x", .driver = "y", .stamped = Stamped::read}).open();
  EXPECT_EQ(log.data, "one two");
}

// A tape may be anybody's, and names and commands are made of its identity.
TEST_F(ReplayHeaderTest, AnIdentityThatCannotBeIsRefusedAndToldOnce) {
  const auto play = [this](const std::string& identity) {
    test::write_file(tape.read, test::block_bytes({{1, "a"}}));
    test::write_file(tape.events,
                     as_bytes(R"({"format":"porttape-events","version":1,"identity":)" + identity + "}\n"));
    ReplayOptions options;
    options.tape = tape;
    port = std::make_unique<ReplayedDevice>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    EXPECT_TRUE(port->prepare().has_value());
    return port->identity().has_value();
  };
  EXPECT_TRUE(play(R"({"path":"/dev/ttyS0"})"));
  EXPECT_EQ(book.text(), "");
  EXPECT_FALSE(play(R"({"path":"/dev/a;b"})"));
  EXPECT_THAT(book.text(), testing::HasSubstr(port->name() + ": its identity is refused: "));
  EXPECT_THAT(book.text(), testing::HasSubstr("has other characters than"));
  EXPECT_EQ(book.text().find("refused"), book.text().rfind("refused"));
}

}  // namespace
}  // namespace porttape
