// One port in two threads: one reads and one writes, and neither holds up the other.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <fcntl.h>
#include <fmt/format.h>
#include <functional>
#include <memory>
#include <poll.h>
#include <string>
#include <string_view>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tests/blocking/blocking_rig.hpp"
#include "tests/support/sockets.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using namespace std::chrono_literals;
using testing::AnyOf;
using testing::HasSubstr;

constexpr int kPatience = 60'000;  // ms, for what must come

// A thread that ends before what it uses.
class Thread {
 public:
  explicit Thread(std::function<void()> work) : thread_(std::move(work)) {}
  ~Thread() { join(); }
  Thread(const Thread&) = delete;
  Thread& operator=(const Thread&) = delete;
  void join() {
    if (thread_.joinable()) thread_.join();
  }

 private:
  std::thread thread_;
};

bool can(int fd, short what) {
  pollfd ready{fd, what, 0};
  return ::poll(&ready, 1, kPatience) == 1;
}

// What the other end of a line does, on a descriptor that does not block.
void send_all(int fd, std::string_view text) {
  while (!text.empty()) {
    ASSERT_TRUE(can(fd, POLLOUT)) << text.size() << " bytes are not taken";
    const ssize_t size = ::write(fd, text.data(), text.size());
    if (size > 0) text.remove_prefix(static_cast<std::size_t>(size));
  }
}

std::string receive_all(int fd, std::size_t count) {
  std::string text;
  std::string piece(65536, '?');
  while (text.size() < count && can(fd, POLLIN)) {
    const ssize_t size = ::read(fd, piece.data(), std::min(piece.size(), count - text.size()));
    if (size > 0) text.append(piece, 0, static_cast<std::size_t>(size));
  }
  return text;
}

// Bytes of which none can be lost, repeated or moved unseen.
std::string numbered(std::size_t size, char mark) {
  std::string text;
  for (unsigned number = 0; text.size() < size; ++number) text += fmt::format("{}{:07}", mark, number);
  text.resize(size);
  return text;
}

std::unique_ptr<BlockingPort> opened(const std::string& spec) {
  auto port = BlockingPort::create(spec);
  EXPECT_TRUE(port.has_value()) << port.error().message;
  const Result<void> open = (*port)->open();
  EXPECT_TRUE(open.has_value()) << open.error().message;
  return std::move(*port);
}

std::string full(BlockingPort& port, std::size_t count) {
  std::string text(count, '?');
  const Result<Transfer> result = port.read_full(room(text));
  return result && result->done() ? text : told(result);
}

std::string line(BlockingPort& port) {
  std::string text;
  const Result<Transfer> result = port.read_line(text);
  return result && result->done() ? text : told(result);
}

class BlockingThreads : public testing::Test {
 protected:
  BlockingThreads() {
    ::grantpt(device.get());
    ::unlockpt(device.get());
  }
  void open(const std::string& more) {
    port = opened(fmt::format("type=serial,device={}{}", ::ptsname(device.get()), more));
  }
  void both_ways(int peer, std::size_t size) {
    const std::string there = numbered(size, 'w');
    const std::string back = numbered(size, 'r');
    std::string got;
    std::string read;
    Thread sends([&] { send_all(peer, back); });
    Thread receives([&] { got = receive_all(peer, size); });
    Thread reads([&] { read = full(*port, size); });
    EXPECT_EQ(told(port->write_full(as_bytes(there))), fmt::format("{} ", size));
    reads.join();
    receives.join();
    EXPECT_TRUE(got == there);
    EXPECT_TRUE(read == back);
  }

  UniqueFd device{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)};
  std::unique_ptr<BlockingPort> port;
};

TEST_F(BlockingThreads, AWriteGoesWhileAReadWaits) {
  open(",timeout=600");
  constexpr int kRounds = 300;
  int right = 0;
  Thread reads([&] {
    for (int round = 0; round < kRounds; ++round) right += full(*port, 6) == "answer" ? 1 : 0;
  });
  for (int round = 0; round < kRounds; ++round) {
    ASSERT_EQ(told(port->write(as_bytes("ask"))), "3 ");
    ASSERT_EQ(receive_all(device.get(), 3), "ask") << "the read waits until this has come";
    send_all(device.get(), "answer");
  }
  reads.join();
  EXPECT_EQ(right, kRounds);
}

TEST_F(BlockingThreads, AReadGetsItsBytesWhileAWriteIsStuck) {
  open("");
  const std::string much = numbered(500'000, 'w');
  std::string written;
  Thread writes([&] { written = told(port->write_full(as_bytes(much))); });
  ASSERT_TRUE(can(device.get(), POLLIN)) << "the write has begun, and cannot end";
  for (int round = 0; round < 100; ++round) {
    send_all(device.get(), "line\n");
    ASSERT_EQ(line(*port), "line\n");
  }
  EXPECT_EQ(port->bytes_available().value(), 0U);
  EXPECT_TRUE(receive_all(device.get(), much.size()) == much);
  writes.join();
  EXPECT_EQ(written, "500000 ");
}

TEST_F(BlockingThreads, ManyBytesGoBothWaysOnASerialLine) {
  open(",timeout=600");
  both_ways(device.get(), 500'000);
}

TEST_F(BlockingThreads, ManyBytesGoBothWaysOnAConnection) {
  const test::Socket server = test::Socket::listening();
  port = opened(fmt::format("type=tcp,timeout=600,port={}", server.port()));
  const test::Socket peer = server.accept();
  ASSERT_EQ(::fcntl(peer.fd(), F_SETFL, O_NONBLOCK), 0);
  both_ways(peer.fd(), 2'000'000);
  port->close();
}

TEST_F(BlockingThreads, DatagramsGoBothWays) {
  const test::Socket peer = test::Socket::datagrams();
  const std::uint16_t number = [] { return test::Socket::datagrams().port(); }();
  port = opened(
      fmt::format("type=udp,dest_ip=127.0.0.1,dest_port={},recv_port={},timeout=600", peer.port(), number));
  constexpr int kRounds = 200;
  int right = 0;
  Thread reads([&] {
    for (int round = 0; round < kRounds; ++round) right += read_some(*port) == "6 answer" ? 1 : 0;
  });
  for (int round = 0; round < kRounds; ++round) {
    ASSERT_EQ(told(port->write(as_bytes("ask"))), "3 ");
    ASSERT_EQ(receive_all(peer.fd(), 3), "ask");
    peer.send_to(number, "answer");
  }
  reads.join();
  EXPECT_EQ(right, kRounds);
}

TEST_F(BlockingThreads, AReadsTimeoutDoesNotEndAWrite) {
  open("");
  const std::string much = numbered(200'000, 'w');
  std::string written;
  Thread writes([&] { written = told(port->write_full(as_bytes(much))); });
  ASSERT_TRUE(can(device.get(), POLLIN));
  port->set_timeout(20ms);
  const Instant begin = machine_clock().now();
  EXPECT_EQ(read_some(*port), "timed out");
  EXPECT_GE(machine_clock().now() - begin, 20ms);
  EXPECT_TRUE(receive_all(device.get(), much.size()) == much);
  writes.join();
  EXPECT_EQ(written, "200000 ") << "it had begun without a timeout, and keeps that";
}

TEST_F(BlockingThreads, AWritesTimeoutDoesNotEndARead) {
  open(",timeout=0.02");
  std::string read;
  Thread reads([&] { read = full(*port, 6); });
  const std::string much = numbered(200'000, 'w');
  EXPECT_THAT(told(port->write_full(as_bytes(much))), HasSubstr("took no byte within the timeout"));
  send_all(device.get(), "answer");
  reads.join();
  EXPECT_EQ(read, "answer");
}

TEST_F(BlockingThreads, OtherCallsMayComeBesideARead) {
  open("");
  std::string read;
  Thread reads([&] { read = line(*port); });
  send_all(device.get(), "par");
  while (port->bytes_available().value() < 3) std::this_thread::yield();
  EXPECT_TRUE(port->is_open() && port->readable());
  EXPECT_THAT(port->status(), HasSubstr("waiting to be read: 3"));
  EXPECT_TRUE(port->set_baud(115200).has_value());
  EXPECT_TRUE(port->flush().has_value()) << "the read waits on, for a whole line";
  send_all(device.get(), "a line\nrest");
  reads.join();
  EXPECT_EQ(read, "a line\n");
  EXPECT_EQ(full(*port, 4), "rest");
}

TEST_F(BlockingThreads, TwoReadersShareWhatComes) {
  open(",timeout=600");
  const auto reads = [&](std::string& into) {
    for (int round = 0; round < 300; ++round) into += line(*port);
  };
  std::string one;
  std::string other;
  Thread first([&] { reads(one); });
  Thread second([&] { reads(other); });
  for (int round = 0; round < 600; ++round) send_all(device.get(), "line\n");
  first.join();
  second.join();
  std::string all;
  for (int round = 0; round < 300; ++round) all += "line\n";
  EXPECT_EQ(one, all);
  EXPECT_EQ(other, all);
}

TEST_F(BlockingThreads, TheEndOfTheLineEndsBothCalls) {
  open("");
  std::string read;
  std::string written;
  const std::string much(200'000, 'w');
  Thread reads([&] { read = read_some(*port); });
  Thread writes([&] { written = told(port->write_full(as_bytes(much))); });
  ASSERT_TRUE(can(device.get(), POLLIN));
  device.reset();
  reads.join();
  writes.join();
  EXPECT_THAT(read, AnyOf("closed", "error: the port is not open")) << "it may have begun after the end";
  EXPECT_THAT(written, HasSubstr("is lost"));
  EXPECT_FALSE(port->is_open());
}

TEST_F(BlockingThreads, ACloseEndsTheCallsThatWait) {
  open("");
  std::string read;
  std::string written;
  const std::string much(200'000, 'w');
  Thread reads([&] {
    read = full(*port, 1);
    read += " " + full(*port, 1);
  });
  Thread writes([&] { written = told(port->write_full(as_bytes(much))); });
  send_all(device.get(), "1");
  ASSERT_TRUE(can(device.get(), POLLIN));
  while (port->bytes_available().value() > 0) std::this_thread::yield();
  port->close();
  reads.join();
  writes.join();
  EXPECT_THAT(read, AnyOf("1 closed", "1 error: the port is not open", "closed error: the port is not open"));
  EXPECT_THAT(written, HasSubstr("not open"));
}

// The driver's close is an end of which a pty has nothing to say.
TEST(BlockingThreadsPty, AnEndWithoutWordsEndsEachCallThatWaits) {
  const test::TempDir dir;
  const std::string link = dir / "line";
  auto port = BlockingPort::create("type=pty,link=" + link);
  ASSERT_TRUE(port.has_value());
  Thread opens([&] { EXPECT_TRUE((*port)->open()); });
  UniqueFd driver;
  while (!driver) {
    std::this_thread::yield();
    driver = UniqueFd(::open(link.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  }
  opens.join();
  const std::string much(200'000, 'w');
  std::string ends[2];
  Thread first([&] { ends[0] = told((*port)->write_full(as_bytes(much))); });
  Thread second([&] { ends[1] = told((*port)->write_full(as_bytes(much))); });
  ASSERT_TRUE(can(driver.get(), POLLIN));
  driver.reset();
  first.join();
  second.join();
  for (const std::string& end : ends)
    EXPECT_THAT(end, AnyOf(HasSubstr("the line is down"), HasSubstr("the port is not open")));
}

TEST(BlockingThreadsListener, ACloseEndsAnOpenThatWaits) {
  const std::uint16_t number = test::Socket::bound().port();
  auto port = BlockingPort::create(fmt::format("type=tcp,listen,port={}", number));
  ASSERT_TRUE(port.has_value());
  std::atomic<bool> over = false;
  std::string error;
  Thread opens([&] {
    const Result<void> open = (*port)->open();
    if (!open) error = open.error().message;
    over = true;
  });
  while (!over) {
    (*port)->close();
    std::this_thread::yield();
  }
  EXPECT_EQ(error, "the port was closed while it was being opened");
}

TEST(BlockingThreadsListener, NeitherCallGoesOnWithThePeerOfAnother) {
  const std::uint16_t number = test::Socket::bound().port();
  auto port = BlockingPort::create(fmt::format("type=tcp,listen,alwaysopen,port={}", number));
  ASSERT_TRUE(port.has_value());
  test::Socket first;
  {
    Thread connects([&] {
      while (first.fd() < 0) {
        try {
          first = test::Socket::connect_to(number);
        } catch (const std::runtime_error&) {
          std::this_thread::yield();  // it does not listen yet
        }
      }
    });
    ASSERT_TRUE((*port)->open().has_value());
  }
  const std::string much(20'000'000, 'w');
  std::string read;
  std::string written;
  Thread reads([&] {
    std::string one;
    do {
      one = line(**port);
      read += one + ", ";
    } while (one == "closed");
  });
  Thread writes([&] { written = told((*port)->write_full(as_bytes(much))); });
  first.send("par");
  ASSERT_TRUE(can(first.fd(), POLLIN));
  while ((*port)->bytes_available().value() < 3) std::this_thread::yield();
  first.reset();
  writes.join();
  EXPECT_EQ(written, "closed") << "its rest is not for the second peer";
  const test::Socket second = test::Socket::connect_to(number);
  second.send("line\n");
  reads.join();
  EXPECT_THAT(read, AnyOf("closed, line\n, ", "line\n, ")) << "it may have begun after the end";
  EXPECT_EQ(told((*port)->write_string("for the second")), "14 ");
  EXPECT_EQ(receive_all(second.fd(), 14), "for the second");
}

TEST(BlockingThreadsTape, ARecordingOfTwoThreadsIsSoundAndWhole) {
  const test::TempDir dir;
  const test::Socket server = test::Socket::listening();
  const std::string there = numbered(700'000, 'w');
  const std::string back = numbered(700'000, 'r');
  auto port = opened(fmt::format("type=tcplog,timeout=600,file={},port={}", dir / "t.log", server.port()));
  const test::Socket peer = server.accept();
  ASSERT_EQ(::fcntl(peer.fd(), F_SETFL, O_NONBLOCK), 0);
  {
    Thread sends([&] { send_all(peer.fd(), back); });
    Thread receives([&] { EXPECT_TRUE(receive_all(peer.fd(), there.size()) == there); });
    Thread reads([&] { EXPECT_TRUE(full(*port, back.size()) == back); });
    Thread writes([&] {
      for (std::size_t at = 0; at < there.size(); at += 1000)
        ASSERT_EQ(told(port->write_full(as_bytes(there).subspan(at, 1000))), "1000 ");
    });
  }
  port->close();
  EXPECT_EQ(port->finish(), 0);

  const TapePaths paths = literal_tape(dir / "t.log");
  const Result<TapeSummary> summary = summarize(paths);
  ASSERT_TRUE(summary.has_value());
  EXPECT_TRUE(summary->damages().empty());
  EXPECT_TRUE(summary->torn_tails().empty());
  std::string reads;
  std::string writes;
  auto tape = TapeReader::open(paths);
  for (auto record = tape->next(); record && *record; record = tape->next()) {
    if ((**record).kind == RecordKind::read) reads += as_text((**record).data);
    if ((**record).kind == RecordKind::write) writes += as_text((**record).data);
  }
  EXPECT_TRUE(reads == back);
  EXPECT_TRUE(writes == there);
}

TEST(BlockingThreadsTape, AReadThatOnlyItsOwnThreadCanEndIsAnErrorBesideOneThatWaits) {
  const test::TempDir dir;
  test::write_file(dir / "t.logr", test::block_bytes({{20, "answer"}}));
  test::write_file(dir / "t.logw", test::block_bytes({{10, "ask"}}));
  auto port = opened("type=logreader,timing=reactive,strictness=1,file=" + (dir / "t.log"));
  std::string read;
  Thread reads([&] { read = full(*port, 6); });
  for (int n = 0; n < 200; ++n) ASSERT_THAT(read_some(*port), HasSubstr("would wait for ever"));
  EXPECT_EQ(told(port->write(as_bytes("ask"))), "3 ");
  reads.join();
  EXPECT_EQ(read, "answer");
}

TEST(BlockingThreadsTape, AReadWaitsForTheWriteOfAnotherThread) {
  const test::TempDir dir;
  test::write_file(dir / "t.logr", test::block_bytes({{20, "answer"}, {40, "bye"}}));
  test::write_file(dir / "t.logw", test::block_bytes({{10, "ask"}, {30, "end"}}));
  auto port = opened("type=logreader,timing=reactive,strictness=1,file=" + (dir / "t.log"));
  std::string read;
  Thread reads([&] {
    read = full(*port, 6);
    read += " " + full(*port, 3);
    read += " " + read_some(*port);
  });
  EXPECT_EQ(told(port->write(as_bytes("ask"))), "3 ");
  EXPECT_EQ(told(port->write(as_bytes("end"))), "3 ");
  reads.join();
  EXPECT_EQ(read, "answer bye closed") << "when the tape is used up nothing can come from any thread";
}

}  // namespace
}  // namespace porttape
