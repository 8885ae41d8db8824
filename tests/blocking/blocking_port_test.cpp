#include "libport/blocking/blocking_port.hpp"

#include <algorithm>
#include <chrono>
#include <fcntl.h>
#include <filesystem>
#include <memory>
#include <poll.h>
#include <string>
#include <string_view>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/blocking/blocking_rig.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/support/trickle.hpp"

namespace porttape {
namespace {

using namespace std::chrono_literals;
using End = Transfer::End;
using testing::HasSubstr;

// A serial port on the slave of a pty whose master the test holds.
class BlockingSerialTest : public testing::Test {
 protected:
  BlockingSerialTest() : device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    ::grantpt(device.get());
    ::unlockpt(device.get());
    path = ::ptsname(device.get());
  }

  void open(const std::string& more = ",timeout=1") {
    auto made = BlockingPort::create("type=serial,device=" + path + more);
    ASSERT_TRUE(made.has_value()) << made.error().message;
    port = std::move(*made);
    const Result<void> opened = port->open();
    ASSERT_TRUE(opened.has_value()) << opened.error().message;
  }
  void device_sends(std::string_view text) {
    ASSERT_EQ(::write(device.get(), text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  std::string device_got() {
    std::string text(70000, '?');
    const ssize_t size = ::read(device.get(), text.data(), text.size());
    return text.substr(0, size < 0 ? 0 : static_cast<std::size_t>(size));
  }

  UniqueFd device;
  std::string path;
  std::unique_ptr<BlockingPort> port;
};

TEST_F(BlockingSerialTest, ReadGivesWhatIsThereUpToWhatWasAskedFor) {
  open();
  device_sends("abcdef");
  EXPECT_EQ(read_some(*port, 4), "4 abcd");
  EXPECT_EQ(read_some(*port, 4), "2 ef");
  EXPECT_EQ(read_some(*port, 4), "timed out");
}

TEST_F(BlockingSerialTest, ATimeoutIsOfTheQuietAndNeverShort) {
  open(",timeout=0.1");
  std::string text;
  const Instant begin = machine_clock().now();
  EXPECT_EQ(told(port->read_line(text)), "timed out");
  EXPECT_GE(machine_clock().now() - begin, 100ms);
  port->set_timeout(1500ms);
  {
    const test::Trickle device_types(device.get(), {"one ", "line ", "in ", "two ", "seconds\n", "rest"},
                                     400ms);
    EXPECT_EQ(told(port->read_line(text), "one line in two seconds\n"), "24 one line in two seconds\n");
    EXPECT_EQ(told(port->read_line(text)), "timed out");
  }
  EXPECT_EQ(read_some(*port), "4 rest") << "what had come is kept";
}

TEST_F(BlockingSerialTest, WithoutATimeoutItWaitsAndWithZeroItDoesNot) {
  open("");
  EXPECT_EQ(port->timeout(), BlockingPort::kForever);
  const test::Trickle later(device.get(), {"late"}, 50ms);
  EXPECT_EQ(read_some(*port), "4 late");
  port->set_timeout(Micros{0});
  EXPECT_EQ(read_some(*port), "timed out");
  device_sends("now");
  port->set_timeout(BlockingPort::kForever);
  EXPECT_EQ(told(port->bytes_available_wait()), "3 ");
  port->set_timeout(Micros{0});
  EXPECT_EQ(read_some(*port), "3 now");
}

TEST_F(BlockingSerialTest, ReadFullIgnoresTheTimeout) {
  open(",timeout=0.01");
  std::string text(5, '?');
  {
    const test::Trickle later(device.get(), {"ab", "cd", "ef"}, 20ms);
    EXPECT_EQ(told(port->read_full(room(text)), text), "5 abcde");
  }
  EXPECT_EQ(read_some(*port), "1 f");
}

TEST_F(BlockingSerialTest, ReadUntilEndsWithTheEndOrWhenFull) {
  open();
  device_sends("one;two;and more");
  std::string text(8, '?');
  EXPECT_EQ(told(port->read_until(room(text), ';'), text), "4 one;");
  EXPECT_EQ(told(port->read_until(room(text), ';'), text), "4 two;");
  EXPECT_EQ(told(port->read_until(room(text), ';'), text), "8 and more");
  device_sends("rest");
  EXPECT_EQ(told(port->read_until(room(text), ';'), text), "timed out");
  device_sends(";");
  EXPECT_EQ(told(port->read_until(room(text), ';'), text), "5 rest;");
}

TEST_F(BlockingSerialTest, StringsAndLines) {
  open();
  device_sends(std::string_view("a\0b\nnext\n", 9));
  std::string text;
  EXPECT_EQ(told(port->read_line(text)).substr(0, 1), "4");
  EXPECT_EQ(text, std::string("a\0b\n", 4));
  EXPECT_EQ(told(port->read_string(text)).substr(0, 1), "5");
  EXPECT_EQ(text, "next\n");
  EXPECT_EQ(told(port->read_string(text)), "timed out");
}

TEST_F(BlockingSerialTest, SkippingDropsAsItGoes) {
  open();
  device_sends("0123456789");
  EXPECT_EQ(told(port->skip(4)), "4 ");
  EXPECT_EQ(told(port->skip_until('6')), "3 ");
  EXPECT_EQ(told(port->skip(100)), "timed out");
  EXPECT_EQ(read_some(*port), "timed out");
  device_sends("a\nb\n\nrest");
  EXPECT_EQ(told(port->skip_until('\n', 3)), "5 ");
  EXPECT_EQ(read_some(*port), "4 rest");
}

TEST_F(BlockingSerialTest, BytesAvailableIsNeverNegative) {
  open();
  EXPECT_EQ(port->bytes_available().value(), 0U);
  EXPECT_EQ(told(port->bytes_available_wait()), "timed out");
  device_sends("123");
  EXPECT_EQ(told(port->bytes_available_wait()), "3 ");
  EXPECT_EQ(port->bytes_available().value(), 3U);
  EXPECT_EQ(read_some(*port), "3 123");
}

TEST_F(BlockingSerialTest, WriteTakesWhatTheLineTakes) {
  open();
  const std::string much(200000, 'w');
  std::size_t written = 0;
  for (;;) {
    const Result<Transfer> result = port->write(as_bytes(much));
    ASSERT_TRUE(result.has_value());
    if (result->end == End::timed_out) break;
    written += result->bytes;
    ASSERT_LT(written, 200000U);
  }
  EXPECT_GT(written, 0U);
  const Result<Transfer> all = port->write_full(as_bytes(much));
  ASSERT_FALSE(all.has_value());
  EXPECT_THAT(all.error().message, HasSubstr("0 of 200000 bytes"));
  std::size_t got = 0;
  for (std::string part = device_got(); !part.empty(); part = device_got()) got += part.size();
  EXPECT_EQ(got, written) << "what a write says is what arrives";
}

TEST_F(BlockingSerialTest, WriteFullWaitsForASlowPeer) {
  open(",timeout=60");
  const std::string much(100000, 'w');
  std::size_t got = 0;
  std::thread reader([&] {
    pollfd readable{device.get(), POLLIN, 0};
    while (got < much.size() && ::poll(&readable, 1, 20'000) > 0) got += device_got().size();
  });
  EXPECT_EQ(told(port->write_full(as_bytes(much))), "100000 ");
  EXPECT_EQ(told(port->drain()), "0 ");
  reader.join();
  EXPECT_EQ(got, much.size());
}

TEST_F(BlockingSerialTest, DrainIsBoundedByTheTimeout) {
  open();
  EXPECT_EQ(told(port->drain()), "0 ");
  EXPECT_EQ(told(port->write(as_bytes("unread"))), "6 ");
  const Instant begin = machine_clock().now();
  const std::string ended = told(port->drain());
  EXPECT_TRUE(ended == "0 " || machine_clock().now() - begin >= port->timeout()) << ended;
  EXPECT_EQ(device_got(), "unread");
  EXPECT_EQ(told(port->drain()), "0 ");
}

TEST_F(BlockingSerialTest, FlushDropsWhatCameAndWhatWasNotSent) {
  open();
  device_sends("old ");
  EXPECT_EQ(told(port->bytes_available_wait()), "4 ");
  const UniqueFd beside(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  device_sends("older");
  pollfd readable{beside.get(), POLLIN, 0};
  ASSERT_EQ(::poll(&readable, 1, 20'000), 1) << "it has come";
  EXPECT_TRUE(port->flush().has_value());
  EXPECT_EQ(read_some(*port), "timed out");
  device_sends("new");
  EXPECT_EQ(read_some(*port), "3 new");
}

TEST_F(BlockingSerialTest, InputIsBoundedAndThePeerHasToWait) {
  open();
  EXPECT_EQ(told(port->bytes_available_wait()), "timed out");
  std::size_t sent = 0;
  const std::string chunk(4000, 'i');
  for (int round = 0; round < 200; ++round) {
    const ssize_t n = ::write(device.get(), chunk.data(), chunk.size());
    if (n > 0) sent += static_cast<std::size_t>(n);
    if (n <= 0 && port->bytes_available().value() >= BlockingPort::kInputLimit) break;
    ASSERT_LT(port->bytes_available().value(), 2 * BlockingPort::kInputLimit);
  }
  EXPECT_LT(sent, 200U * chunk.size());
  std::string all(sent, '?');
  EXPECT_EQ(port->read_full(room(all)).value(), Transfer{sent})
      << "more than is kept can be asked for at once";
  EXPECT_EQ(all, std::string(sent, 'i'));
}

TEST_F(BlockingSerialTest, PermissionsAndStateAreChecked) {
  open(",readonly");
  EXPECT_THAT(told(port->write(as_bytes("x"))), HasSubstr("may not be written"));
  port->set_can_read(false);
  EXPECT_THAT(read_some(*port), HasSubstr("may not be read"));
  EXPECT_FALSE(port->open().has_value()) << "it is open";
  port->close();
  port->close();
  EXPECT_FALSE(port->is_open());
  port->set_can_read(true);
  EXPECT_THAT(read_some(*port), HasSubstr("not open"));
  EXPECT_FALSE(port->flush().has_value());
  port->set_can_write(true);
  ASSERT_TRUE(port->open().has_value());
  EXPECT_EQ(told(port->write(as_bytes("x"))), "1 ") << "wider from the next open on";
  EXPECT_EQ(device_got(), "x");
}

TEST_F(BlockingSerialTest, ALostDeviceEndsTheLineAfterItsLastBytes) {
  open();
  device_sends("last");
  EXPECT_EQ(told(port->bytes_available_wait()), "4 ");
  device.reset();
  std::string text;
  EXPECT_EQ(told(port->read_line(text)), "closed");
  EXPECT_FALSE(port->is_open());
  EXPECT_EQ(read_some(*port), "4 last");
  EXPECT_THAT(read_some(*port), HasSubstr("not open"));
  EXPECT_THAT(told(port->write(as_bytes("x"))), HasSubstr("not open"));
}

TEST_F(BlockingSerialTest, AWriteToALostDeviceIsAnError) {
  open();
  device.reset();
  EXPECT_THAT(told(port->write(as_bytes("x"))), HasSubstr("is lost"));
  EXPECT_FALSE(port->is_open());
}

TEST_F(BlockingSerialTest, TheSpeedChangesWhileOpen) {
  open();
  EXPECT_TRUE(port->set_baud(115200).has_value());
  EXPECT_THAT(port->status(), HasSubstr("baud: 115200"));
}

TEST(BlockingPort, AMissingDeviceIsToldAtOnce) {
  auto port = BlockingPort::create("serial:/dev/no-such-tty");
  ASSERT_TRUE(port.has_value());
  const Result<void> opened = (*port)->open();
  ASSERT_FALSE(opened.has_value());
  EXPECT_EQ(opened.error().code, Errc::device_missing);
  EXPECT_FALSE((*port)->is_open());
}

TEST(BlockingPort, AnAlwaysOpenLineComesBack) {
  const test::TempDir dir;
  const std::string link = dir / "port";
  const auto plug = [&](UniqueFd& master) {
    master.reset(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
    ::grantpt(master.get());
    ::unlockpt(master.get());
    std::filesystem::create_symlink(::ptsname(master.get()), link);
  };
  const auto unplug = [&](UniqueFd& master) {
    std::filesystem::remove(link);  // before its number is another pty's
    master.reset();
  };
  UniqueFd master;
  plug(master);
  auto port = BlockingPort::create("type=serial,alwaysopen,timeout=0.05,device=" + link);
  ASSERT_TRUE(port.has_value() && (*port)->open().has_value());
  unplug(master);
  EXPECT_EQ(read_some(**port), "closed");
  EXPECT_TRUE((*port)->is_open());
  EXPECT_EQ(read_some(**port), "timed out");
  EXPECT_EQ(told((*port)->write(as_bytes("x"))), "timed out");
  plug(master);
  (*port)->set_timeout(20s);
  EXPECT_EQ(told((*port)->write(as_bytes("back"))), "4 ");
  ASSERT_EQ(::write(master.get(), "yes", 3), 3);
  EXPECT_EQ(read_some(**port), "3 yes");
}

}  // namespace
}  // namespace porttape
