// More than a replaying port can look at, and what of it is dropped.

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/budget.hpp"
#include "libport/tape/event.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/taped/replay_port_fixture.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

// More at once than is looked at in a turn: whoever writes waits, and is told when he may go on, however the
// rest comes to nothing.
TEST_F(ReplayPortTest, TheEndOfItsCongestionIsTold) {
  const std::string much(std::size_t{4} << 20, 'x');
  test::write_file(dir / "t.logw", test::block_bytes({{0, much}}));
  start();
  write(much);
  ASSERT_TRUE(port->congested());
  EXPECT_THAT(log.events, Not(HasSubstr("drained")));
  run_until(loop, [this] { return !port->congested(); });
  EXPECT_THAT(log.events, HasSubstr("drained"));
  const std::size_t first = log.events.find("drained");
  EXPECT_EQ(log.events.find("drained", first + 1), std::string::npos) << log.events;
  (void)finish();
}

// What one turn does not look at waits for the next; of that there may be 64 KiB.
TEST_F(ReplayPortTest, MoreThanItHasRoomForCongestsItAndTheEndIsTold) {
  constexpr std::size_t kRoom = std::size_t{64} << 10;
  test::write_file(dir / "t.logw",
                   test::block_bytes(std::vector(24, test::Block{0, std::string(kRoom / 4, 'x')})));
  for (const std::size_t left : {kRoom, kRoom + 1}) {
    log.events.clear();
    start();
    write(std::string(Budget::kBytes + left, 'x'));
    EXPECT_FALSE(port->congested()) << "the next turn comes at once";
    EXPECT_EQ(log.events, left > kRoom ? "up drained " : "up ");
  }
}

// What one turn left is the next one's, all of it.
TEST_F(ReplayPortTest, TheEndOfItsCongestionIsToldWhereAllTheRestGoesAtOnce) {
  constexpr std::size_t kBlock = std::size_t{32} << 10;
  const std::string block(kBlock, 'x');
  Bytes blocks;
  std::string much;
  while (much.size() < Budget::kBytes + 3 * kBlock) {
    const Bytes next = test::block_bytes({{0, block}});
    blocks.insert(blocks.end(), next.begin(), next.end());
    much += block;
  }
  test::write_file(dir / "t.logw", blocks);
  start();
  write(much);
  run_until(loop, [this] { return !port->congested(); });
  EXPECT_THAT(log.events, HasSubstr("drained")) << "it was congested for the moment";
  (void)finish();
}

// What is due waits for a driver that does not read; what comes next waits for its question.
class FlushOfATape : public ReplayPortTest {
 protected:
  std::string left_after(FlushQueue queue) {
    log.data.clear();
    flush_unread(queue);
    return log.data;
  }
};

TEST_F(FlushOfATape, DropsWhatIsDueAndUnreadAndNothingElse) {
  EXPECT_EQ(left_after(FlushQueue::in), "new");
  EXPECT_EQ(left_after(FlushQueue::both), "new");
  EXPECT_EQ(left_after(FlushQueue::out), "oldnew");
}

TEST_F(FlushOfATape, AFloodOfThemLogsNothing) {
  test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}}));
  test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{})));
  start();
  const std::string before = book.text();
  for (int i = 0; i < 10'000; ++i) port->tell(line::Flush{FlushQueue::both});
  EXPECT_EQ(book.text(), before);
}

TEST_F(ReplayPortTest, AFlushOfATapeWithoutEventsDropsNothingThatItsDriverRead) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}}));
  test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}}));
  start();
  port->set_reading(false);
  write("ask");
  port->tell(line::Flush{FlushQueue::both});
  port->set_reading(true);
  run_until(loop, [this] { return log.data == "old"; });
}

// A program that waits in its calls, and whose flush the tape is to follow.
class DiscardingReplay : public ReplayPortTest {
 protected:
  bool discards(Timing asked, bool events = true) {
    test::write_file(dir / "t.logr", test::block_bytes({{0, "old"}, {3'600'000'000, "new"}}));
    if (events) test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{})));
    ReplayOptions options;
    options.tape = literal_tape(dir / "t.log");
    options.config.timing = asked;
    port = std::make_unique<ReplayedDevice>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    EXPECT_FALSE(port->waiting()->discard()) << "the tape is not open yet";
    EXPECT_TRUE(port->prepare().has_value());
    port->open();
    return port->waiting()->discard();
  }
};

TEST_F(DiscardingReplay, FollowsItsProgramWhereTheTapeDoesNotKeepItsOwnTime) {
  EXPECT_TRUE(discards(Timing::reactive));
  EXPECT_TRUE(discards(Timing::none));
  EXPECT_FALSE(discards(Timing::recorded));
}

TEST_F(DiscardingReplay, DoesNotFollowItWithoutEventsWhichWouldHaveTheRecordedFlushes) {
  EXPECT_FALSE(discards(Timing::reactive, false));
}

// How the line of a driver ends that has not closed it.
class EndOfTheLine : public ReplayPortTest {
 protected:
  EndOfTheLine() {
    test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}, {2, "bye"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{1, "answer"}}));
  }
};

TEST_F(EndOfTheLine, BehindTheTapeTheDriverReadsWhatIsLeft) {
  at_end = AtEnd::hangup;
  start();
  write("askbye");
  run_until(loop, [this] { return log.events == "up hung_up "; });
  EXPECT_EQ(log.data, "answer");
  EXPECT_TRUE(log.after_reading);
  EXPECT_EQ(log.error.message, "");
}

// The report waits for the driver's going, which tells how much it left unread.
class UnreadBehindTheTape : public ReplayPortTest {
 protected:
  UnreadBehindTheTape() {
    test::write_file(dir / "t.logr", test::block_bytes({{1, "hello"}}));
    at_end = AtEnd::hangup;
  }
  void play() {
    start();
    run_until(loop, [this] { return log.events == "up hung_up "; });
    EXPECT_EQ(log.data, "hello");
    EXPECT_FALSE(port->report().has_value());
  }
};

TEST_F(UnreadBehindTheTape, IsTheVerdict) {
  play();
  port->tell(line::LeftUnread{5});
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 5);
  EXPECT_EQ(port->report()->unread, 5U);
}

TEST_F(UnreadBehindTheTape, IsNothingWhereItReadAll) {
  play();
  port->tell(line::LeftUnread{0});
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  EXPECT_TRUE(port->report()->doubts.empty());
}

TEST_F(UnreadBehindTheTape, IsNotKnownOfADriverThatIsThereAtTheEnd) {
  play();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  ASSERT_EQ(port->report()->doubts.size(), 1U);
  EXPECT_EQ(port->report()->doubts[0].kind, Doubt::Kind::unread);
}

TEST_F(UnreadBehindTheTape, IsThatOfTheRunThatEndedAndNotOfTheNext) {
  play();
  port->tell(line::LeftUnread{2});
  port->close();
  log.events.clear();
  port->open();
  run_until(loop, [this] { return log.events == "up hung_up " && port->report().has_value(); });
  EXPECT_EQ(port->report()->unread, 2U);
  port->tell(line::LeftUnread{0});
  port->close();
  (void)finish();
  EXPECT_EQ(port->report()->unread, std::nullopt);
}

TEST_F(EndOfTheLine, AtAMismatchItBreaksWhereItStandsAndSaysWhy) {
  start();
  write("oh");
  EXPECT_EQ(log.events, "up hung_up ");
  EXPECT_FALSE(log.after_reading);
  EXPECT_THAT(log.error.message, HasSubstr("data mismatch"));
}

TEST_F(EndOfTheLine, AtAMismatchThatIsOnlyToldItStays) {
  start({}, OnMismatch::warn);
  write("oh!");
  EXPECT_EQ(log.events, "up ");
  EXPECT_THAT(book.text(), HasSubstr("data mismatch"));
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(EndOfTheLine, AnEndThatIsAskedForIsNotToldAsThatOfARunThatIsTheOnlyOne) {
  once = true;
  start();
  write("ask");
  (void)finish();
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(log.status, 5);
}

TEST_F(EndOfTheLine, ADriverThatWroteNothingHasOnlyLooked) {
  start();
  port->close();
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_THAT(book.text(), HasSubstr("t.log: the driver wrote nothing, and the tape has writes: a look, and "
                                     "no run"));
  (void)finish();
}

}  // namespace
}  // namespace porttape
