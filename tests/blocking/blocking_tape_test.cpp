// Blocking ports and tapes: logreader and the recording ports, in the program's own process.
#include <chrono>
#include <fcntl.h>
#include <fmt/format.h>
#include <memory>
#include <string>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/loop/timer.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tests/blocking/blocking_rig.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

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
    begin = machine_clock().now();
    const Result<void> opened = port->open();
    EXPECT_TRUE(opened.has_value());
    return *port;
  }

  test::TempDir dir;
  std::unique_ptr<BlockingPort> port;
  Instant begin;
};

TEST_F(BlockingReplayTest, ReadsGiveWhatIsDueElseWaitForIt) {
  tape({{0, "now"}, {1'000'000, "later"}}, {});
  open("timeout=60");
  EXPECT_EQ(read_some(*port), "3 now");
  EXPECT_EQ(read_some(*port, 2), "2 la");
  EXPECT_GE(machine_clock().now() - begin, 999ms);
  EXPECT_EQ(read_some(*port), "3 ter") << "what does not fit is kept";
}

TEST_F(BlockingReplayTest, ATimeoutShorterThanTheGapTimesOut) {
  tape({{1'500'000, "later"}}, {});
  open("timeout=0.02");
  EXPECT_EQ(read_some(*port), "timed out");
  EXPECT_GE(machine_clock().now() - begin, 20ms);
  port->set_timeout(60s);
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
  open("timeout=60,at-end=hangup");
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
  open("timing=reactive,strictness=1,timeout=60");
  EXPECT_EQ(told(port->write(as_bytes("as"))), "2 ");
  const std::string error = told(port->write(as_bytes("XX")));
  EXPECT_THAT(error, HasSubstr("byte 2 of all it wrote"));
  EXPECT_THAT(error, HasSubstr("61 73 -- 6b"));
  EXPECT_THAT(error, HasSubstr("61 73 58 58"));
  EXPECT_FALSE(port->is_open());
  ASSERT_TRUE(port->open().has_value()) << "a new run";
  EXPECT_EQ(told(port->write(as_bytes("ask"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST_F(BlockingReplayTest, MismatchesPassWhereAskedFor) {
  tape({{20, "answer"}}, {{10, "ask"}});
  open("timing=reactive,strictness=1,timeout=60,on-mismatch=warn");
  EXPECT_EQ(told(port->write(as_bytes("aXk"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
  open("timing=reactive,strictness=0,timeout=60");
  EXPECT_EQ(told(port->write(as_bytes("xyz"))), "3 ");
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST_F(BlockingReplayTest, StrictnessTwoRefusesEarlyWrites) {
  tape({}, {{100, "first"}, {3'000'000, "second"}});
  open("strictness=2,jitter=2000,timeout=60");
  EXPECT_EQ(told(port->write(as_bytes("first"))), "5 ");
  EXPECT_THAT(told(port->write(as_bytes("second"))), HasSubstr("earlier"));
}

TEST_F(BlockingReplayTest, LateWritesPassWhereAskedFor) {
  tape({}, {{1000, "first"}});
  for (const bool early_only : {true, false}) {
    open(early_only ? "strictness=2,jitter=1,timeout=60,early-only" : "strictness=2,jitter=1,timeout=60");
    port->set_timeout(30ms);
    EXPECT_EQ(told(port->bytes_available_wait()), "timed out");
    EXPECT_EQ(told(port->write(as_bytes("first"))) == "5 ", early_only);
  }
}

TEST_F(BlockingReplayTest, WhatFellDueBetweenCallsCameInTime) {
  tape({{10'000, "unread"}}, {{100, "first"}, {60'000, "second"}});
  // However late the test gets on: taken for later than it was, the answer would make the write too early.
  open("timing=reactive,strictness=2,jitter=10,early-only,timeout=60");
  EXPECT_EQ(told(port->write(as_bytes("first"))), "5 ");
  Loop other;  // nothing calls the port meanwhile
  bool over = false;
  Timer second_is_due(other, [&over] { over = true; });
  second_is_due.set_after(60ms);
  run_until(other, [&over] { return over; });
  EXPECT_EQ(told(port->write(as_bytes("second"))), "6 ") << "measured from when the answer was due";
}

TEST_F(BlockingReplayTest, DamageIsAnErrorAfterWhatIsSound) {
  tape({{0, "sound"}, {10, "also"}, {5, "back in time"}}, {{1, "ask"}});
  open("timeout=60,strictness=1,timing=none");
  EXPECT_EQ(told(port->write(as_bytes("ask"))), "3 ");
  EXPECT_EQ(read_some(*port), "9 soundalso");
  EXPECT_THAT(read_some(*port), HasSubstr("is damaged at offset"));
  EXPECT_FALSE(port->is_open());
}

TEST_F(BlockingReplayTest, FlushKeepsATapeOfWhatWasRead) {
  tape({{0, "answer"}}, {});
  open("timeout=60");
  EXPECT_TRUE(port->flush().has_value());
  EXPECT_EQ(read_some(*port), "6 answer");
}

TEST(BlockingTape, ATapeRecordedInProcessReplaysInProcess) {
  const test::TempDir dir;
  UniqueFd device(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ::grantpt(device.get());
  ::unlockpt(device.get());
  auto port = BlockingPort::create(
      fmt::format("type=seriallog,file={},device={},timeout=60", dir / "t.log", ::ptsname(device.get())));
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
  const auto header = TapeReader::open(literal_tape(dir / "t.log"))->header();
  ASSERT_TRUE(header.has_value());
  EXPECT_EQ(header->device, fmt::format("serial:{},timeout=60", ::ptsname(device.get())));
  EXPECT_EQ(header->stamped, Stamped::read) << "bytes are seen when the program reads";
  EXPECT_EQ(header->transport, Transport::stream);

  auto replay = BlockingPort::create(
      "type=logreader,strictness=2,jitter=10000,timing=reactive,timeout=60,file=" + (dir / "t.log"));
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

// Asks at 19200 baud, and once more at 57600.
class BlockingSettings : public testing::Test {
 public:
  BlockingSettings() {
    ::grantpt(device.get());
    ::unlockpt(device.get());
  }
  void record() {
    auto port = BlockingPort::create(fmt::format("type=seriallog,file={},device={},baud=19200,timeout=60",
                                                 dir / "t.log", ::ptsname(device.get())));
    ASSERT_TRUE(port.has_value());
    ASSERT_TRUE((*port)->open().has_value());
    ask(**port);
    ASSERT_TRUE((*port)->set_baud(57600).has_value());
    ASSERT_TRUE((*port)->set_baud(57600).has_value());
    ask(**port);
    (*port)->close();
    ASSERT_EQ((*port)->finish(), 0);
  }
  void ask(BlockingPort& port) {
    EXPECT_EQ(told(port.write(as_bytes("ask"))), "3 ");
    ASSERT_EQ(::write(device.get(), "answer", 6), 6);
    EXPECT_EQ(read_some(port), "6 answer");
  }
  // The exit status of a replay that sets `baud` before its second question; 0: it does not.
  int replay(unsigned baud) {
    auto port = BlockingPort::create(
        "type=logreader,strictness=1,timing=reactive,timeout=60,check-settings,file=" + (dir / "t.log"));
    EXPECT_TRUE(port.has_value() && (*port)->open().has_value());
    for (int question = 1; question <= 2; ++question) {
      if (question == 2 && baud > 0) {
        EXPECT_TRUE((*port)->set_baud(baud).has_value());
      }
      EXPECT_EQ(told((*port)->write(as_bytes("ask"))), "3 ");
      EXPECT_EQ(read_some(**port), "6 answer");
    }
    (*port)->close();
    return (*port)->finish();
  }
  std::string events() {
    std::string text;
    auto tape = TapeReader::open(literal_tape(dir / "t.log"));
    for (auto record = tape->next(); record && *record; record = tape->next()) {
      const Event* const event = (**record).event;
      const auto* settings = event == nullptr ? nullptr : std::get_if<event::Settings>(event);
      if (settings != nullptr) {
        text +=
            fmt::format("{} {}{}, ", settings->by == Side::driver ? "driver" : "device",
                        to_text(settings->line), settings->order == SettingsOrder::exact ? "" : " (sampled)");
      } else if ((**record).kind == RecordKind::write) {
        text += "ask, ";
      }
    }
    return text;
  }

  test::TempDir dir;
  UniqueFd device{::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)};
};

TEST_F(BlockingSettings, AreOnTheTapeAndHeldAgainstItAtTheReplay) {
  ASSERT_NO_FATAL_FAILURE(record());
  EXPECT_EQ(events(), "device 19200 baud, 8N1, ask, driver 57600 baud, 8N1, ask, ");
  EXPECT_EQ(replay(57600), exit_status::kPass);
  EXPECT_EQ(replay(0), exit_status::kDataMismatch);
  EXPECT_EQ(replay(300), exit_status::kDataMismatch);
}

TEST_F(BlockingSettings, ATapeThatTellsOfNoneTakesAny) {
  test::write_file(dir / "t.logr", test::block_bytes({{0, "answer"}}));
  auto port = BlockingPort::create("type=logreader,check-settings,timeout=60,file=" + (dir / "t.log"));
  ASSERT_TRUE(port.has_value());
  EXPECT_TRUE((*port)->set_baud(300).has_value());
  ASSERT_TRUE((*port)->open().has_value());
  EXPECT_TRUE((*port)->set_baud(600).has_value());
  EXPECT_EQ(read_some(**port), "6 answer");
  (*port)->close();
  EXPECT_EQ((*port)->finish(), 0);
}

TEST_F(BlockingSettings, ALineWithoutThemSaysSo) {
  auto port = BlockingPort::create("type=udp,timeout=60");
  ASSERT_TRUE(port.has_value() && (*port)->open().has_value());
  const Result<void> set = (*port)->set_baud(300);
  ASSERT_FALSE(set.has_value());
  EXPECT_THAT(set.error().message, HasSubstr("has no baud rate"));
}

TEST(BlockingTape, ALineThatCannotBeOpenedLeavesTheOldTape) {
  const test::TempDir dir;
  for (const char* file : {"t.logr", "t.logw"})
    test::write_file(dir / file, test::block_bytes({{0, "kept"}}));
  auto port = BlockingPort::create("type=tcplog,overwrite,port=1,timeout=60,file=" + (dir / "t.log"));
  ASSERT_TRUE(port.has_value());
  EXPECT_FALSE((*port)->open().has_value());
  port->reset();
  EXPECT_EQ(test::read_file(dir / "t.logr"), test::block_bytes({{0, "kept"}}));
}

}  // namespace
}  // namespace porttape
