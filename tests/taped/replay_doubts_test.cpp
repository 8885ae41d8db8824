// What keeps the verdict of a replay from being a bare pass.

#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/block.hpp"
#include "libport/tape/event.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/taped/replay_port_fixture.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

TEST_F(ReplayPortTest, AnEndThatIsMissingIsADoubt) {
  test::write_file(dir / "t.logr", {});
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  for (const bool ended : {false, true}) {
    std::string events = encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{});
    if (ended) events += encode(tape_time_us(50), event::End{});
    test::write_file(dir / "t.loge", as_bytes(events));
    start();
    write("one");
    port->close();
    run_until(loop, [this] { return port->report().has_value(); });
    EXPECT_EQ(port->report()->verdict, Verdict::pass);
    ASSERT_EQ(port->report()->doubts.size(), ended ? 0U : 1U);
    for (const Doubt& doubt : port->report()->doubts)
      EXPECT_THAT(doubt.text, HasSubstr("the tape has no end"));
  }
}

// An older tape's end says no more than that it is one. A recorder makes both files.
TEST_F(ReplayPortTest, AFileThatIsMissingOfWhichTheEndTellsNothingIsADoubt) {
  const std::string end =
      encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) + encode(tape_time_us(50), event::End{});
  test::write_file(dir / "t.loge", as_bytes(end));
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  for (const bool missing : {true, false}) {
    if (!missing) test::write_file(dir / "t.logr", {});
    start();
    write("one");
    port->close();
    run_until(loop, [this] { return port->report().has_value(); });
    EXPECT_EQ(port->report()->verdict, Verdict::pass);
    ASSERT_EQ(port->report()->doubts.size(), missing ? 1U : 0U);
    for (const Doubt& doubt : port->report()->doubts) {
      EXPECT_EQ(doubt.kind, Doubt::Kind::unchecked);
      EXPECT_THAT(doubt.text, HasSubstr("t.logr is missing"));
    }
  }
}

TEST_F(ReplayPortTest, AStallDuringTheRunIsADoubt) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start();
  write("one");
  loop.post([this, begin = loop.now()] {
    while (loop.now() - begin < std::chrono::milliseconds(60)) {
    }
  });
  loop.post([this] { port->close(); });
  loop.post([this] { port->finish(); });
  loop.run();
  EXPECT_EQ(log.status, 0);
  ASSERT_TRUE(port->report().has_value());
  ASSERT_FALSE(port->report()->doubts.empty());
  EXPECT_EQ(port->report()->doubts.at(0).kind, Doubt::Kind::stall);
  EXPECT_THAT(port->report()->doubts.at(0).text, HasSubstr("stood still for"));
}

// A recorded tape; one that is small is checked before it is played, and any other meanwhile.
class CheckedReplay : public ReplayPortTest {
 protected:
  static constexpr std::size_t kSmall = 65536;  // bytes of both files

  // The answer makes the files as large as that.
  void record(std::size_t bytes) {
    const std::size_t headers = 3 * kHeaderSize;
    answer_ = std::string(bytes - headers - 3 - 3, 'x');
    test::MemoryTape tape;
    tape.open(0).write(10, "one").read(20, answer_).write(30, "two").close(40);
    test::write_tape(literal_tape(dir / "t.log"), tape, {.device = "d", .driver = "p"});
  }
  void flip(const char* file, std::size_t at) {
    Bytes all = test::read_file(dir / file);
    all.at(at) ^= 1;
    test::write_file(dir / file, all);
  }
  Result<void> prepared() {
    ReplayOptions options;
    options.tape = literal_tape(dir / "t.log");
    ReplayedDevice made(PortContext{&loop, book.log()}, std::move(options));
    made.listen(log);
    return made.prepare();
  }
  void play() {
    start();
    write("one");
    run_until(loop, [this] { return log.data.size() == answer_.size(); });
    write("two");
    port->close();
    (void)finish();
  }

  std::string answer_;
};

TEST_F(CheckedReplay, ASmallTapeThatIsChangedIsNotPlayed) {
  record(kSmall);
  ASSERT_TRUE(prepared());
  flip("t.logr", 7);
  ASSERT_FALSE(prepared());
  EXPECT_EQ(prepared().error().code, Errc::damaged_tape);
  EXPECT_THAT(prepared().error().message, HasSubstr("t.logr has other times or lengths of blocks"));
  flip("t.logr", 7);
  flip("t.logr", kHeaderSize);
  EXPECT_THAT(prepared().error().message, HasSubstr("t.logr is another tape's, or changed"));
  flip("t.logr", kHeaderSize);
  flip("t.loge", 2);
  EXPECT_FALSE(prepared());
}

TEST_F(CheckedReplay, ALargerOneThatIsChangedFailsItsRun) {
  record(kSmall + 1);
  flip("t.logw", 2 * kHeaderSize + 3 - 5);  // the second block's time
  ASSERT_TRUE(prepared());
  play();
  EXPECT_EQ(log.status, 1);
  EXPECT_EQ(port->report()->verdict, Verdict::incomplete) << "nothing passes by it";
  EXPECT_THAT(port->report()->trouble.value_or(""), HasSubstr("t.logw has other times or lengths of blocks"));
}

TEST_F(CheckedReplay, ALargerOneThatIsSoundPassesWithoutADoubt) {
  record(kSmall + 1);
  play();
  EXPECT_EQ(log.status, 0) << book.text();
  EXPECT_EQ(port->report()->verdict, Verdict::pass);
  EXPECT_THAT(port->report()->doubts, testing::IsEmpty());
}

TEST_F(CheckedReplay, AMismatchStaysTheVerdictOfAChangedTape) {
  record(kSmall + 1);
  flip("t.logr", 7);
  start();
  write("other");
  (void)finish();
  EXPECT_EQ(log.status, 1);
  EXPECT_EQ(port->report()->verdict, Verdict::data_mismatch);
  EXPECT_TRUE(port->report()->trouble.has_value());
}

// Its end tells of as many empty blocks as its r file has, which nobody waits for.
TEST_F(CheckedReplay, OneThatIsNotReadInTimeIsADoubt) {
  constexpr std::uintmax_t size = std::uintmax_t{3} << 30;
  test::write_file(dir / "t.logw", test::block_bytes({{10, "one"}}));
  test::write_file(dir / "t.logr", ByteView{});
  std::filesystem::resize_file(dir / "t.logr", size);
  PayloadCounter writes;
  writes.begin_block(tape_time_us(10), 3);
  writes.add(as_bytes("one"));
  const PayloadTotals read{size / kHeaderSize, 0, 0, 0};
  const std::string lines = encode(TapeHeader{.device = "d", .driver = "p", .id = "0123"}) +
                            encode(tape_time_us(0), event::Open{}) + encode(tape_time_us(20), event::Close{});
  const event::End end{read, writes.totals(), digest_of(as_bytes(lines))};
  test::write_file(dir / "t.loge", as_bytes(lines + encode(tape_time_us(21), end)));
  start();
  write("one");
  port->close();
  (void)finish();
  ASSERT_TRUE(port->report().has_value());
  EXPECT_THAT(port->report()->doubts,
              testing::Contains(testing::Field(&Doubt::kind, Doubt::Kind::unchecked)));
}

// Bytes that the driver dropped before they were read may be wrong or right.
class OutputFlushesOfARun : public ReplayPortTest {
 protected:
  // Of a driver that writes twice and drops its output behind the writes that the tape has a flush for.
  void record(bool first, bool second) {
    test::MemoryTape tape;
    tape.open(0).event(1, event::Flush{FlushQueue::both}).write(10, "one");
    if (first) tape.event(20, event::Flush{FlushQueue::out});
    tape.write(30, "two");
    if (second) tape.event(40, event::Flush{FlushQueue::both});
    tape.close(50);
    test::write_tape(literal_tape(dir / "t.log"), tape, {.device = "d", .driver = "p"});
  }
  // Of one that does so behind each.
  std::vector<std::string> doubts() {
    log.status.reset();
    start();
    port->tell(line::Flush{FlushQueue::both});
    write("one");
    port->tell(line::Flush{FlushQueue::in});
    port->tell(line::Flush{FlushQueue::out});
    port->tell(line::Flush{FlushQueue::out});
    write("two");
    port->tell(line::Flush{FlushQueue::both});
    port->close();
    (void)finish();
    EXPECT_EQ(port->report()->verdict, Verdict::pass) << book.text();
    std::vector<std::string> all;
    for (const Doubt& doubt : port->report()->doubts) {
      EXPECT_EQ(doubt.kind, Doubt::Kind::flushed);
      all.push_back(doubt.text);
    }
    return all;
  }
};

TEST_F(OutputFlushesOfARun, OftenerThanOnTheTapeAreADoubt) {
  record(true, true);
  EXPECT_THAT(doubts(), testing::IsEmpty());
  const std::string told = "the driver dropped what it had written (tcflush) ";
  const std::string unknown =
      " more often than on the tape: whether all of it had been read before nobody knows";
  std::filesystem::remove(dir / "t.loge");
  for (const char* file : {"t.logr", "t.logw"}) std::filesystem::remove(dir / file);
  record(true, false);
  EXPECT_THAT(doubts(), testing::ElementsAre(told + "once" + unknown));
  for (const char* file : {"t.logr", "t.logw", "t.loge"}) std::filesystem::remove(dir / file);
  record(false, false);
  EXPECT_THAT(doubts(), testing::ElementsAre(told + "2 times" + unknown));
}

TEST_F(ReplayPortTest, WhoWasTurnedAwayBehindTheLastRunIsADoubtOfThat) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start();
  write("one");
  port->close();
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_TRUE(port->report()->doubts.empty());
  port->tell(line::Refused{2});
  (void)finish();
  ASSERT_EQ(port->report()->doubts.size(), 1U);
  EXPECT_EQ(port->report()->doubts[0].kind, Doubt::Kind::refused);
  EXPECT_TRUE(port->report()->again);
  EXPECT_THAT(book.text(), HasSubstr("1 run"));
}

TEST_F(ReplayPortTest, WhoWasTurnedAwayIsADoubt) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  const auto doubts = [this](std::vector<std::uint64_t> others) {
    log.status.reset();
    start();
    write("one");
    for (const std::uint64_t bytes : others) port->tell(line::Refused{bytes});
    port->close();
    (void)finish();
    std::string all;
    for (const Doubt& doubt : port->report()->doubts) all += doubt.text + '\n';
    return all;
  };
  EXPECT_EQ(doubts({}), "");
  EXPECT_EQ(doubts({5}),
            "another connection came while the driver was there and was turned away: 5 bytes that it had "
            "written are on no tape (see --connections)\n");
  EXPECT_EQ(doubts({5, 2}),
            "2 other connections came while the driver was there and were turned away: 7 bytes that they "
            "had written are on no tape (see --connections)\n");
  EXPECT_EQ(doubts({}), "") << "those were of the sessions before";
  EXPECT_EQ(doubts({0, 0}),
            "2 other connections came while the driver was there and were turned away: 0 bytes that they "
            "had written are on no tape (see --connections)\n");
}

TEST_F(ReplayPortTest, ATornTailOfATapeWithoutEventsIsADoubt) {
  Bytes torn = test::block_bytes({{0, "one"}, {10, "two"}});
  torn.resize(torn.size() - 1);
  test::write_file(dir / "t.logw", torn);
  start();
  write("one");
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  ASSERT_EQ(port->report()->doubts.size(), 1U);
  EXPECT_EQ(port->report()->doubts[0].kind, Doubt::Kind::gap);
  EXPECT_THAT(port->report()->doubts[0].text, HasSubstr("t.logw: torn tail at offset 15"));
  EXPECT_THAT(port->report()->doubts[0].text, HasSubstr("what came last may be missing"));
}

// As `porttape verify` has it.
TEST_F(ReplayPortTest, WhatIsBehindWhatTheEndTellsOfIsADoubt) {
  const auto played = [this](const Bytes& writes, const std::string& behind_end) {
    test::write_file(dir / "t.logw", writes);
    test::write_file(dir / "t.logr", {});
    const event::End end{.read = PayloadTotals{0, 0, {}}, .write = PayloadTotals{1, 3, {}}};
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                              encode(tape_time_us(50), end) + behind_end));
    log.status.reset();
    start();
    write("one");
    port->close();
    (void)finish();
    EXPECT_EQ(log.status, 0);
    std::string all;
    for (const Doubt& doubt : port->report()->doubts) all += doubt.text + '\n';
    return all;
  };
  Bytes writes = test::block_bytes({{0, "one"}});
  EXPECT_EQ(played(writes, ""), "");
  EXPECT_THAT(played(writes, encode(tape_time_us(60), event::Mark{"m"})),
              HasSubstr("events stand behind the tape's end"));
  EXPECT_THAT(played(writes, R"({"t_us":)"), HasSubstr("is unfinished and does not count"));
  test::append(writes, "12345");
  EXPECT_THAT(played(writes, ""),
              HasSubstr("t.logw has 5 bytes behind the last block that its tape's end tells of"));
}

TEST_F(ReplayPortTest, ATornTailIsNoDoubtWhereNobodyCame) {
  Bytes torn = test::block_bytes({{0, "one"}, {10, "two"}});
  torn.resize(torn.size() - 1);
  test::write_file(dir / "t.logw", torn);
  start({}, OnMismatch::fail, false);
  (void)finish();
  ASSERT_TRUE(port->report().has_value());
  EXPECT_TRUE(port->report()->nobody_came);
  EXPECT_TRUE(port->report()->doubts.empty());
}

// What is unread at the driver's close.
class UnreadOfATape : public ReplayPortTest {
 protected:
  UnreadOfATape() { test::write_file(dir / "t.logr", test::block_bytes({{0, "hello"}})); }
  void listen_and_leave(std::uint64_t unread) {
    start();
    run_until(loop, [this] { return log.data == "hello"; });
    port->tell(line::LeftUnread{unread});
    port->close();
    (void)finish();
  }
};

TEST_F(UnreadOfATape, IsTheVerdictWhereItIsAllThatATapeSays) {
  listen_and_leave(5);
  EXPECT_EQ(log.status, 5);
  EXPECT_EQ(port->report()->unread, 5U);
}

TEST_F(UnreadOfATape, IsADoubtWhereSomethingWasRead) {
  listen_and_leave(2);
  EXPECT_EQ(log.status, 0);
  ASSERT_EQ(port->report()->doubts.size(), 1U);
  EXPECT_THAT(port->report()->doubts[0].text, HasSubstr("2 bytes of 5 (40.0 %)"));
}

// The tape "t" has two sessions of one exchange each.
class UnreadOfSessions : public ReplayPortTest {
 protected:
  UnreadOfSessions() {
    test::write_file(dir / "t.logw", test::block_bytes({{10, "a"}, {1010, "b"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{20, "one"}, {1020, "two"}}));
    const auto at = [](std::int64_t time) { return TapeTime{Micros(time)}; };
    std::string events = encode(TapeHeader{});
    events += encode(at(0), event::Open{}) + encode(at(500), event::Close{});
    events += encode(at(1000), event::Open{}) + encode(at(1500), event::Close{});
    test::write_file(dir / "t.loge", as_bytes(events));
  }
  void exchange(std::string_view question, std::string_view all) {
    write(question);
    run_until(loop, [&] { return log.data == all; });
  }
};

TEST_F(UnreadOfSessions, IsTheSumOfAllThatWasLeft) {
  start();
  exchange("a", "one");
  port->tell(line::LeftUnread{3});
  port->close();
  port->open();
  exchange("b", "onetwo");
  port->tell(line::LeftUnread{1});
  port->close();
  (void)finish();
  EXPECT_EQ(port->report()->left_unread, 1U);
  EXPECT_EQ(port->report()->unread, 4U);
}

TEST_F(UnreadOfSessions, IsOfOneRunAlone) {
  start();
  for (const std::uint64_t left : {3U, 0U}) {
    log.data.clear();
    exchange("a", "one");
    port->tell(line::LeftUnread{left});
    port->close();
    port->open();
    exchange("b", "onetwo");
    port->tell(line::LeftUnread{0});
    port->close();
    run_until(loop, [this] { return port->report().has_value(); });
    if (left > 0) port->open();
  }
  (void)finish();
  EXPECT_EQ(port->report()->unread, std::nullopt);
}

TEST_F(UnreadOfATape, IsNothingThatTheDriverFlushed) {
  flush_unread(FlushQueue::in);
  EXPECT_EQ(log.data, "new");
  (void)finish();
  EXPECT_EQ(port->report()->reads_excused, 3U);
  EXPECT_EQ(port->report()->unread, std::nullopt);
}

}  // namespace
}  // namespace porttape
