#include "libport/port/blocking_port.hpp"

#include <algorithm>
#include <array>
#include <fcntl.h>
#include <fmt/format.h>
#include <memory>
#include <string>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using namespace std::chrono_literals;
using End = Transfer::End;
using testing::HasSubstr;

std::span<Byte> room(std::string& text) { return {reinterpret_cast<Byte*>(text.data()), text.size()}; }

// "12 text", "timed out", "closed" or "error: …": how a reading call ended.
std::string told(const Result<Transfer>& result, const std::string& text = {}) {
  if (!result) return "error: " + result.error().message;
  if (result->end == End::timed_out) return "timed out";
  if (result->end == End::closed) return "closed";
  return fmt::format("{} {}", result->bytes, text.substr(0, result->bytes));
}

std::string read_some(BlockingPort& port, std::size_t most = 100) {
  std::string text(most, '?');
  const Result<Transfer> result = port.read(room(text));
  return told(result, text);
}

// A serial port on the slave of a pty whose master the test holds.
class BlockingSerialTest : public testing::Test {
 protected:
  BlockingSerialTest() : device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    ::grantpt(device.get());
    ::unlockpt(device.get());
    path = ::ptsname(device.get());
  }

  void open(const std::string& more = ",timeout=0.05") {
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

TEST_F(BlockingSerialTest, ATimeoutIsOfTheWholeCallAndNeverShort) {
  open(",timeout=0.1");
  std::thread trickle([this] {
    for (int i = 0; i < 20; ++i) {
      std::this_thread::sleep_for(10ms);
      device_sends("x");
    }
  });
  std::string text;
  const Instant begin = Loop::now();
  EXPECT_EQ(told(port->read_line(text)), "timed out");
  const Nanos took = Loop::now() - begin;
  trickle.join();
  EXPECT_GE(took, 100ms);
  EXPECT_EQ(read_some(*port), "20 xxxxxxxxxxxxxxxxxxxx") << "what had come is kept";
}

TEST_F(BlockingSerialTest, WithoutATimeoutItWaitsAndWithZeroItDoesNot) {
  open("");
  EXPECT_EQ(port->timeout(), BlockingPort::kForever);
  std::thread later([this] {
    std::this_thread::sleep_for(50ms);
    device_sends("late");
  });
  EXPECT_EQ(read_some(*port), "4 late");
  later.join();
  port->set_timeout(Micros{0});
  EXPECT_EQ(read_some(*port), "timed out");
  device_sends("now");
  std::this_thread::sleep_for(1ms);
  EXPECT_EQ(read_some(*port), "3 now");
}

TEST_F(BlockingSerialTest, ReadFullIgnoresTheTimeout) {
  open(",timeout=0.01");
  std::thread later([this] {
    for (const char* part : {"ab", "cd", "ef"}) {
      std::this_thread::sleep_for(20ms);
      device_sends(part);
    }
  });
  std::string text(5, '?');
  EXPECT_EQ(told(port->read_full(room(text)), text), "5 abcde");
  later.join();
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
  open(",timeout=5");
  const std::string much(100000, 'w');
  std::size_t got = 0;
  std::thread reader([&] {
    while (got < much.size()) {
      got += device_got().size();
      std::this_thread::sleep_for(1ms);
    }
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
  const Instant begin = Loop::now();
  const std::string ended = told(port->drain());
  EXPECT_TRUE(ended == "0 " || Loop::now() - begin >= 50ms) << ended;
  EXPECT_EQ(device_got(), "unread");
  EXPECT_EQ(told(port->drain()), "0 ");
}

TEST_F(BlockingSerialTest, FlushDropsWhatCameAndWhatWasNotSent) {
  open();
  device_sends("old ");
  EXPECT_EQ(told(port->bytes_available_wait()), "4 ");
  device_sends("older");
  std::this_thread::sleep_for(1ms);
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
    std::filesystem::remove(link);
    std::filesystem::create_symlink(::ptsname(master.get()), link);
  };
  UniqueFd master;
  plug(master);
  auto port = BlockingPort::create("type=serial,alwaysopen,timeout=0.05,device=" + link);
  ASSERT_TRUE(port.has_value() && (*port)->open().has_value());
  master.reset();
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

// A logreader on a tape made by the test.
class BlockingReplayTest : public testing::Test {
 protected:
  void tape(const std::vector<test::Block>& reads, const std::vector<test::Block>& writes) {
    test::write_file(dir / "tape.logr", test::block_bytes(reads));
    test::write_file(dir / "tape.logw", test::block_bytes(writes));
  }
  BlockingPort& open(const std::string& more) {
    auto made = BlockingPort::create("type=logreader,file=" + (dir / "tape.log") + "," + more);
    EXPECT_TRUE(made.has_value()) << made.error().message;
    port = std::move(*made);
    const Result<void> opened = port->open();
    EXPECT_TRUE(opened.has_value());
    begin = Loop::now();
    return *port;
  }

  test::TempDir dir;
  std::unique_ptr<BlockingPort> port;
  Instant begin;
};

TEST_F(BlockingReplayTest, ReadsGiveWhatIsDueElseWaitForIt) {
  tape({{0, "now"}, {60'000, "later"}}, {});
  open("timeout=5");
  EXPECT_EQ(read_some(*port), "3 now");
  EXPECT_EQ(read_some(*port, 2), "2 la");
  EXPECT_GE(Loop::now() - begin, 59ms);
  EXPECT_EQ(read_some(*port), "3 ter") << "what does not fit is kept";
}

TEST_F(BlockingReplayTest, ATimeoutShorterThanTheGapTimesOut) {
  tape({{200'000, "later"}}, {});
  open("timeout=0.02");
  EXPECT_EQ(read_some(*port), "timed out");
  EXPECT_GE(Loop::now() - begin, 20ms);
  port->set_timeout(5s);
  EXPECT_EQ(read_some(*port), "5 later");
}

TEST_F(BlockingReplayTest, TheEndOfTheTapeIsSilenceOrTheEndOfTheLine) {
  tape({{0, "all"}}, {});
  open("timeout=0.02");
  EXPECT_EQ(read_some(*port), "3 all");
  EXPECT_EQ(read_some(*port), "timed out");
  EXPECT_TRUE(port->is_open());
  port->set_timeout(BlockingPort::kForever);
  EXPECT_EQ(read_some(*port), "closed") << "nothing will ever come";
  EXPECT_FALSE(port->is_open());
  open("timeout=5,at-end=hangup");
  EXPECT_EQ(read_some(*port), "3 all");
  EXPECT_EQ(read_some(*port), "closed");
}

TEST_F(BlockingReplayTest, AWaitThatNothingEndsIsAnError) {
  tape({{20, "answer"}}, {{10, "ask"}});
  open("timing=reactive,strictness=1");
  EXPECT_THAT(read_some(*port), HasSubstr("\"ask\""));
  EXPECT_EQ(told(port->write(as_bytes("ask"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST_F(BlockingReplayTest, AWrongWriteFailsWithWhatIsWrong) {
  tape({{20, "answer"}}, {{10, "ask"}});
  open("timing=reactive,strictness=1,timeout=1");
  EXPECT_EQ(told(port->write(as_bytes("as"))), "2 ");
  const std::string error = told(port->write(as_bytes("XX")));
  EXPECT_THAT(error, HasSubstr("byte 2 from the driver"));
  EXPECT_THAT(error, HasSubstr("61 73 6b"));
  EXPECT_THAT(error, HasSubstr("61 73 58 58"));
  EXPECT_FALSE(port->is_open());
  ASSERT_TRUE(port->open().has_value()) << "a new run";
  EXPECT_EQ(told(port->write(as_bytes("ask"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST_F(BlockingReplayTest, MismatchesPassWhereAskedFor) {
  tape({{20, "answer"}}, {{10, "ask"}});
  open("timing=reactive,strictness=1,timeout=5,on-mismatch=warn");
  EXPECT_EQ(told(port->write(as_bytes("aXk"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
  open("timing=reactive,strictness=0,timeout=5");
  EXPECT_EQ(told(port->write(as_bytes("xyz"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST_F(BlockingReplayTest, StrictnessTwoRefusesEarlyWrites) {
  tape({}, {{100, "first"}, {3'000'000, "second"}});
  open("strictness=2,jitter=500,timeout=1");
  EXPECT_EQ(told(port->write(as_bytes("first"))), "5 ");
  EXPECT_THAT(told(port->write(as_bytes("second"))), HasSubstr("early"));
}

TEST_F(BlockingReplayTest, LateWritesPassWhereAskedFor) {
  tape({}, {{1000, "first"}});
  for (const bool early_only : {true, false}) {
    open(early_only ? "strictness=2,jitter=1,timeout=1,early-only" : "strictness=2,jitter=1,timeout=1");
    std::this_thread::sleep_for(30ms);
    EXPECT_EQ(told(port->write(as_bytes("first"))) == "5 ", early_only);
  }
}

TEST_F(BlockingReplayTest, WhatFellDueBetweenCallsCameInTime) {
  tape({{10'000, "unread"}}, {{100, "first"}, {200'000, "second"}});
  open("timing=reactive,strictness=2,jitter=150,timeout=1");
  EXPECT_EQ(told(port->write(as_bytes("first"))), "5 ");
  std::this_thread::sleep_for(200ms);
  EXPECT_EQ(told(port->write(as_bytes("second"))), "6 ") << "measured from when the answer was due";
}

TEST_F(BlockingReplayTest, FlushKeepsATapeOfWhatWasRead) {
  tape({{0, "answer"}}, {});
  open("timeout=1");
  EXPECT_TRUE(port->flush().has_value());
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST(BlockingPort, ATapeRecordedInProcessReplaysInProcess) {
  const test::TempDir dir;
  UniqueFd device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(device.get());
  ::unlockpt(device.get());
  auto port = BlockingPort::create(
      fmt::format("type=seriallog,file={},device={},timeout=5", dir / "t.log", ::ptsname(device.get())));
  ASSERT_TRUE(port.has_value() && (*port)->open().has_value());
  EXPECT_EQ(told((*port)->write(as_bytes("ask"))), "3 ");
  ASSERT_EQ(::write(device.get(), "answer", 6), 6);
  EXPECT_EQ(read_some(**port), "6 answer");
  ASSERT_EQ(::write(device.get(), "noise", 5), 5);
  EXPECT_EQ(told((*port)->bytes_available_wait()), "5 ");
  EXPECT_TRUE((*port)->flush().has_value());
  EXPECT_EQ(told((*port)->write(as_bytes("bye"))), "3 ");
  (*port)->close();
  EXPECT_EQ((*port)->finish(), 0);

  auto replay = BlockingPort::create(
      "type=logreader,strictness=2,jitter=10000,timing=reactive,timeout=5,file=" + (dir / "t.log"));
  ASSERT_TRUE(replay.has_value() && (*replay)->open().has_value());
  EXPECT_EQ(told((*replay)->write(as_bytes("ask"))), "3 ");
  EXPECT_EQ(read_some(**replay, 6), "6 answer") << "what follows may have come too";
  EXPECT_EQ(told((*replay)->bytes_available_wait()), "5 ");
  EXPECT_TRUE((*replay)->flush().has_value());
  EXPECT_EQ((*replay)->bytes_available().value(), 0U) << "dropped as it was when recorded";
  EXPECT_EQ(told((*replay)->write(as_bytes("bye"))), "3 ");
  (*replay)->close();
  EXPECT_EQ((*replay)->finish(), 0);
}

TEST(BlockingPort, ALineThatCannotBeOpenedLeavesTheOldTape) {
  const test::TempDir dir;
  for (const char* file : {"t.logr", "t.logw"})
    test::write_file(dir / file, test::block_bytes({{0, "kept"}}));
  auto port = BlockingPort::create("type=tcplog,overwrite,port=1,timeout=5,file=" + (dir / "t.log"));
  ASSERT_TRUE(port.has_value());
  EXPECT_FALSE((*port)->open().has_value());
  port->reset();
  EXPECT_EQ(test::read_file(dir / "t.logr"), test::block_bytes({{0, "kept"}}));
}

}  // namespace
}  // namespace porttape
