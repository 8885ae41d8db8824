// Blocking ports on sockets: peers that come, go, and half-close.
#include <atomic>
#include <fmt/format.h>
#include <memory>
#include <poll.h>
#include <stdexcept>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/blocking/blocking_rig.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {
namespace {

using test::Socket;
using testing::HasSubstr;

void expect_got(Socket& peer, const std::string& text) {
  pollfd readable{peer.fd(), POLLIN, 0};
  while (peer.got.size() < text.size() && peer.ended.empty() && ::poll(&readable, 1, 20'000) == 1)
    peer.receive();
  EXPECT_EQ(peer.got, text);
}

std::unique_ptr<BlockingPort> made(const std::string& spec) {
  auto port = BlockingPort::create(spec);
  EXPECT_TRUE(port.has_value()) << port.error().message;
  return std::move(*port);
}

class BlockingListener : public testing::Test {
 protected:
  // A peer that is there before the port opens: open() takes it.
  void open(const std::string& more) {
    number = Socket::bound().port();
    port = made(fmt::format("type=tcp,listen,timeout=60,port={}{}", number, more));
    std::atomic<bool> given_up = false;
    std::thread peer([this, &given_up] {
      while (!given_up) {
        try {
          first = Socket::connect_to(number);
          return;
        } catch (const std::runtime_error&) {
          std::this_thread::yield();  // it does not listen yet
        }
      }
    });
    const Result<void> opened = port->open();
    if (!opened) given_up = true;
    peer.join();
    ASSERT_TRUE(opened.has_value()) << opened.error().message;
  }
  std::string line() {
    std::string text;
    const std::string how = told(port->read_line(text), text);
    return how.starts_with("error") || text.empty() ? how : text;
  }

  std::uint16_t number = 0;
  Socket first;
  std::unique_ptr<BlockingPort> port;
};

TEST_F(BlockingListener, APeersBytesNeverJoinTheNextOnes) {
  open(",alwaysopen");
  first.send("par");
  first.close();
  Socket second = Socket::connect_to(number);
  second.send("tial\n");
  EXPECT_EQ(line(), "closed");
  EXPECT_EQ(read_some(*port), "3 par");
  EXPECT_EQ(line(), "tial\n");
  EXPECT_EQ(told(port->write_string("for the second\n")), "15 ");
  expect_got(second, "for the second\n");
}

TEST_F(BlockingListener, WithoutAlwaysOpenTheLineEndsWithItsPeer) {
  open("");
  first.send("all\n");
  first.close();
  EXPECT_EQ(line(), "all\n");
  EXPECT_EQ(line(), "closed");
  EXPECT_FALSE(port->is_open());
}

TEST_F(BlockingListener, AHalfClosedPeerGetsItsAnswer) {
  open("");
  first.send("ask\n");
  first.end_sending();
  EXPECT_EQ(line(), "ask\n");
  EXPECT_EQ(port->bytes_available().value(), 0U);
  EXPECT_EQ(told(port->write_string("answer\n")), "7 ");
  expect_got(first, "answer\n");
  EXPECT_EQ(line(), "closed");
}

TEST(BlockingSocket, AServerThatHalfClosesIsStillWrittenTo) {
  Socket server = Socket::listening();
  auto port = made(fmt::format("type=tcp,timeout=60,port={}", server.port()));
  ASSERT_TRUE(port->open().has_value());
  Socket peer = server.accept();
  peer.send("greeting\n");
  peer.end_sending();
  std::string text;
  EXPECT_EQ(told(port->read_line(text), "greeting\n"), "9 greeting\n");
  EXPECT_EQ(told(port->write_string("thanks\n")), "7 ");
  expect_got(peer, "thanks\n");
  EXPECT_EQ(told(port->read_line(text)), "closed");
}

TEST(BlockingSocket, DatagramsGoToANameAndHaveALimit) {
  const Socket peer = Socket::datagrams();
  auto port =
      made(fmt::format("type=udp,dest_ip=localhost,dest_port={},recv_port=0,timeout=60", peer.port()));
  const Result<void> opened = port->open();
  ASSERT_TRUE(opened.has_value()) << opened.error().message;
  EXPECT_EQ(told(port->write_string("hello")), "5 ");
  EXPECT_THAT(told(port->write(as_bytes(std::string(70'000, 'x')))), HasSubstr("do not fit a datagram"));
}

TEST(BlockingSocket, ANameThatDoesNotResolveIsTold) {
  auto port = made("type=udp,dest_ip=nowhere.invalid,recv_port=0,timeout=60");
  const Result<void> opened = port->open();
  ASSERT_FALSE(opened.has_value());
  EXPECT_THAT(opened.error().message, HasSubstr("nowhere.invalid"));
}

}  // namespace
}  // namespace porttape
