// The replaying port: what it does off the loop, and when its end is told.

#include <filesystem>
#include <memory>
#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/replay_clock.hpp"
#include "libport/tape/event.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/time_bound.hpp"
#include "tests/taped/replay_port_fixture.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

TEST_F(ReplayPortTest, TheHintIsInTheReportThoughTheLineHungUpBefore) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}, {10, "two\n"}, {20, "three\n"}}));
  start();
  write("three\n");
  EXPECT_THAT(log.events, HasSubstr("hung_up"));
  EXPECT_FALSE(port->report().has_value()) << "the report follows";
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_THAT(port->report()->mismatch->hint, HasSubstr("comes later at offset 8"));
  EXPECT_THAT(book.text(), HasSubstr("comes later at offset 8"));
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

class LookingOn : public ReplayPortTest {
 protected:
  LookingOn() {
    looks_on = true;
    test::write_file(dir / "t.logw",
                     test::block_bytes({{0, "one\n"}, {10'000, "two\n"}, {20'000, "three\n"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{5'000, "1\n"}, {15'000, "2\n"}, {25'000, "3\n"}}));
  }
};

TEST_F(LookingOn, TheLineHangsUpOnceTheDriverIsQuiet) {
  start();
  write("xxx");
  EXPECT_EQ(log.events, "up ");
  write("y\n");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(log.events, "up hung_up ");
  EXPECT_EQ(as_text(port->report()->mismatch->came), "xxxy\n");
  EXPECT_EQ(as_text(port->report()->mismatch->got), "xxxy\n");
  EXPECT_EQ(log.data, "") << "the tape has no answer to that";
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(LookingOn, ARequestOfAnotherPlaceIsAnsweredAndWhatFollowsIsKept) {
  start(dir / "report.json");
  write("two\n");
  run_until(loop, [this] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "2\n");
  write("one\n");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_TRUE(port->report()->mismatch->answered);
  ASSERT_TRUE(port->report()->diagnosis.cause.has_value());
  EXPECT_EQ(port->report()->diagnosis.cause->text, "exchanges 1 and 2 swapped: request 2 came first");
  EXPECT_EQ(port->report()->to_driver_bytes, 0U) << "it is no part of the counts";
  EXPECT_THAT(port->report()->mismatch->hint, HasSubstr("comes later at offset 4"));
  (void)finish();
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))),
              HasSubstr(R"("cause":{"kind":"swapped")"));
}

TEST_F(LookingOn, WhereTheTimeAloneIsWrongNothingIsWaitedFor) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}, {3'600'000'000, "two\n"}}));
  test::write_file(dir / "t.logr", test::block_bytes({{5'000, "1\n"}}));
  strictness = 2;
  start();
  write("one\n");
  run_until(loop, [this] { return log.data == "1\n"; });
  write("two\n");
  EXPECT_EQ(log.events, "up hung_up ");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(port->report()->verdict, Verdict::timing_mismatch);
}

TEST_F(LookingOn, WhatNoRequestOfALookupIsIsReported) {
  match = Match::lookup;
  start();
  write("xx\n");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(as_text(port->report()->mismatch->came), "xx\n");
  EXPECT_EQ(as_text(port->report()->mismatch->got), "xx\n");
  EXPECT_TRUE(port->report()->diagnosis.cause.has_value());
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(LookingOn, WhatComesForARequestOfALookupIsReportedFromItsDifferenceOn) {
  match = Match::lookup;
  start();
  write("tx");
  write("y\n");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(as_text(port->report()->mismatch->came), "xy\n");
  EXPECT_EQ(as_text(port->report()->mismatch->got), "xy\n");
  EXPECT_THAT(port->report()->diagnosis.cause->text, testing::Not(HasSubstr("answer to request")));
}

TEST_F(LookingOn, ADriverThatWritesOnAndOnIsHungUpAllTheSame) {
  start();
  write("zzz");
  for (std::size_t i = 0; i < Mismatch::kMostCame; ++i) write("z");
  EXPECT_THAT(log.events, HasSubstr("hung_up"));
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(port->report()->mismatch->came.size(), Mismatch::kMostCame);
  (void)finish();
}

TEST_F(LookingOn, ACloseAndTheEndOfTheProgramAreNotWaitedFor) {
  start();
  write("three\n");
  port->close();
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(log.events, "up ") << "the line is closed, and needs no hang-up";
  EXPECT_EQ(port->report()->verdict, Verdict::data_mismatch);
  port->open();
  write("xxx\n");
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(ReplayPortTest, ADamagedTapeLeavesAReportWithoutACause) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}, {10, "two\n"}}));
  start();
  std::filesystem::remove(dir / "t.logw");
  write("oxe\n");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_FALSE(port->report()->diagnosis.cause.has_value());
  EXPECT_EQ(port->report()->verdict, Verdict::data_mismatch);
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(ReplayPortTest, DamageEndsTheLineBehindWhatIsBeforeIt) {
  Bytes damaged = test::block_bytes({{0, "one"}});
  const Bytes header = test::header_bytes(0, 2'000'000, 3);  // no time has so many microseconds
  damaged.insert(damaged.end(), header.begin(), header.end());
  test::append(damaged, "two");
  test::write_file(dir / "t.logr", damaged);
  start();
  run_until(loop, [this] { return log.events == "up lost "; });
  EXPECT_EQ(log.data, "one");
  EXPECT_TRUE(log.after_reading);
  EXPECT_EQ(log.error.code, Errc::damaged_tape);
  EXPECT_THAT(log.error.message, HasSubstr("t.logr"));
  (void)finish();
  EXPECT_EQ(log.status, 1);
}

TEST_F(ReplayPortTest, FilesThatAreNotWhatTheEndTellsAreNotPlayed) {
  const auto events = [&](const event::End& end) {
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                              encode(tape_time_us(50), end)));
  };
  const auto said = [&] {
    ReplayOptions options;
    options.tape = literal_tape(dir / "t.log");
    ReplayedDevice other(PortContext{&loop, book.log()}, std::move(options));
    other.listen(log);
    const Result<void> prepared = other.prepare();
    return prepared ? std::string("plays") : prepared.error().message;
  };
  test::write_file(dir / "t.logr", test::block_bytes({{5, "1\n"}}));
  events({.read = PayloadTotals{1, 2, {}}, .write = PayloadTotals{2, 8, {}}});
  EXPECT_THAT(said(), HasSubstr("t.logw is missing, and by its tape's end it has 32 (2 blocks)"));
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}}));
  EXPECT_THAT(said(), HasSubstr("t.logw has 16 bytes, and by its tape's end it has 32"));
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}, {10, "two\n"}}));
  EXPECT_EQ(said(), "plays");
  Bytes more = test::block_bytes({{0, "one\n"}, {10, "two\n"}, {20, "6"}});
  test::write_file(dir / "t.logw", more);
  EXPECT_THAT(said(), HasSubstr("t.logw has 45 bytes, and by its tape's end it has 32"));
  more.pop_back();
  test::write_file(dir / "t.logw", more);
  EXPECT_EQ(said(), "plays") << "what is no whole block does not count";
  events({});
  test::write_file(dir / "t.logw", {});
  EXPECT_EQ(said(), "plays") << "an end that tells nothing of the files";
}

TEST_F(ReplayPortTest, TheReportIsInTheLogWithoutAnEmptyLineBehindIt) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start();
  write("one");
  port->close();
  (void)finish();
  EXPECT_THAT(book.text(), HasSubstr("pass"));
  EXPECT_THAT(book.text(), testing::Not(HasSubstr("\n\n")));
}

TEST_F(ReplayPortTest, TheReportFileIsThereWhenTheEndIsTold) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start(dir / "report.json");
  write("one");
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))), HasSubstr(R"("verdict":"pass")"));
}

TEST_F(ReplayPortTest, TheReportHasTheFaultsOfItsRunAndThePlanOfAll) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start(dir / "report.json");
  port->tell(LineFault{.kind = "plan", .spec = "drop:p=1", .seed = 7});
  port->tell(LineFault{.kind = "drop", .spec = "drop:byte=3:dir=r", .dir = LineDir::r, .offset = 3});
  port->tell(LineFault{.kind = "more", .count = 4});
  write("one");
  port->close();
  run_until(loop, [this] { return port->report().has_value(); });
  ASSERT_TRUE(port->report()->faults.has_value());
  EXPECT_EQ(port->report()->faults->made, 5U);
  EXPECT_THAT(to_text(*port->report()), HasSubstr("faults    5 made (1 drop, 4 more) by drop:p=1; seed 7"));
  port->open();
  write("one");
  port->close();
  (void)finish();
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))),
              HasSubstr(R"("faults":{"plan":"drop:p=1","seed":7,"made":0,"kinds":{},"list":[]})"));
}

TEST_F(ReplayPortTest, TheStatusIsTheWorstRunsAndTheFileHasAllOfThem) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start(dir / "report.json");
  write("oxe");
  port->close();
  port->open();
  write("one");
  port->close();
  port->open();  // a look
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 3);
  const std::string file(as_text(test::read_file(dir / "report.json")));
  EXPECT_THAT(file, HasSubstr(R"({"verdict":"pass","exit":3,)"));
  EXPECT_THAT(file, HasSubstr(R"("runs":{"count":2,"looks":1,"worst":"data-mismatch","list":[{)"));
  EXPECT_THAT(file, testing::ContainsRegex(R"("when":"[0-9-]+T[0-9:]+\.[0-9]+Z")"));
  EXPECT_THAT(book.text(), HasSubstr("2 runs, the worst: data-mismatch; 1 look"));
}

TEST_F(ReplayPortTest, APieceFollowsWhenTheDriverHasReadTheOneBefore) {
  test::write_file(dir / "t.logr", test::block_bytes({{0, "hello"}}));
  chunks = Chunks::bytes;
  log.peer_unread = 0;
  start();
  run_until(loop, [this] { return log.data == "hello"; });
  EXPECT_EQ(log.arrivals, 5U);
}

TEST_F(ReplayPortTest, APieceFollowsTooWhereNothingTellsWhetherTheDriverReads) {
  test::write_file(dir / "t.logr", test::block_bytes({{0, "hello"}}));
  chunks = Chunks::bytes;
  for (const auto& unread : {std::optional<std::size_t>(), std::optional<std::size_t>(5)}) {
    log.data.clear();
    log.arrivals = 0;
    log.peer_unread = unread;
    start();
    run_until(loop, [this] { return log.data == "hello"; });
    EXPECT_EQ(log.arrivals, 5U);
  }
}

TEST_F(ReplayPortTest, ATapeOfDatagramsIsNotCut) {
  test::write_file(dir / "t.logr", test::block_bytes({{0, "hello"}}));
  test::write_file(
      dir / "t.loge",
      as_bytes(encode(TapeHeader{.device = {}, .driver = {}, .transport = Transport::datagram})));
  ReplayOptions options;
  options.tape = literal_tape(dir / "t.log");
  options.config.chunks = Chunks::random;
  ReplayedDevice other(PortContext{&loop, book.log()}, std::move(options));
  other.listen(log);
  const Result<void> prepared = other.prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_THAT(prepared.error().message, HasSubstr("'chunks'"));
}

// Two sessions of one exchange each.
class TwoSessions : public ReplayPortTest {
 protected:
  TwoSessions() {
    test::write_file(dir / "t.logw", test::block_bytes({{1'000, "one"}, {101'000, "two!"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{2'000, "first"}, {102'000, "second"}}));
    test::write_file(dir / "t.loge",
                     as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                              encode(tape_time_us(5'000), event::Close{}) +
                              encode(tape_time_us(90'000), event::Gap{3, tape_time_us(80'000), "disk full"}) +
                              encode(tape_time_us(100'000), event::Open{}) +
                              encode(tape_time_us(105'000), event::Close{}) +
                              encode(tape_time_us(105'000), event::End{})));
  }
};

TEST_F(TwoSessions, OneOfThemIsPlayedAsIfItWereTheTape) {
  session = 2;
  start(dir / "report.json");
  write("two!");
  run_until(loop, [this] { return !log.data.empty(); });
  EXPECT_EQ(log.data, "second");
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0) << book.text();
  const std::string file(as_text(test::read_file(dir / "report.json")));
  EXPECT_THAT(file,
              HasSubstr(R"("to_driver":{"bytes":6,"of":6},"from_driver":{"bytes":4,"matched":4,"of":4})"));
  EXPECT_THAT(file, HasSubstr(R"("sessions":{"made":1,"of":1},"session":2)"));
  EXPECT_THAT(file, HasSubstr(R"("doubts":[])")) << "the gap is before it";
}

TEST_F(TwoSessions, UnderLookupAllTheirRequestsAreAnsweredInEither) {
  match = Match::lookup;
  start(dir / "report.json");
  for (const auto& [request, answer] :
       {std::pair("two!", "second"), std::pair("one", "first"), std::pair("two!", "second")}) {
    log.data.clear();
    write(request);
    run_until(loop, [&, wanted = answer] { return log.data == wanted; });
  }
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0) << book.text();
  EXPECT_THAT(
      std::string(as_text(test::read_file(dir / "report.json"))),
      HasSubstr(
          R"("lookup":{"requests":2,"asked":2,"answered":3,"unknown":0,"undelivered":0,"never_asked":[]})"));
}

TEST_F(TwoSessions, UnderLookupOneOfThemIsAllThereIs) {
  match = Match::lookup;
  session = 2;
  start();
  write("two!");
  run_until(loop, [this] { return log.data == "second"; });
  write("one");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(port->report()->verdict, Verdict::data_mismatch);
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(TwoSessions, UnderResyncTheAnswerThatFollowsIsReadWhereItStands) {
  start(dir / "report.json", OnMismatch::resync);
  write("two!");
  run_until(loop, [this] { return log.data == "second"; });
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 3);
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))),
              HasSubstr(R"("went_on":"the tape goes on at 0.101000 s: 1 request skipped")"));
}

TEST_F(TwoSessions, AHintIsOfThePartThatIsPlayed) {
  session = 2;
  start();
  write("one");
  run_until(loop, [this] { return port->report().has_value(); });
  EXPECT_EQ(port->report()->mismatch->tape_offset, 0U);
  EXPECT_EQ(port->report()->mismatch->hint, "");
  (void)finish();
  EXPECT_EQ(log.status, 3);
}

TEST_F(TwoSessions, OneThatIsNotThereIsAnErrorThatSaysHowManyThereAre) {
  ReplayOptions options;
  options.tape = literal_tape(dir / "t.log");
  options.session = 3;
  ReplayedDevice other(PortContext{&loop, book.log()}, std::move(options));
  other.listen(log);
  const Result<void> prepared = other.prepare();
  ASSERT_FALSE(prepared.has_value());
  EXPECT_EQ(prepared.error().code, Errc::usage);
  EXPECT_THAT(prepared.error().message, HasSubstr("has 2 sessions, and no number 3"));
}

TEST_F(ReplayPortTest, TheDevicesHalfCloseIsToldAndTheDriversIsWaitedFor) {
  test::write_file(dir / "t.logw", test::block_bytes({{1'000, "ask"}}));
  test::write_file(dir / "t.logr", test::block_bytes({{3'000, "answer"}}));
  test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                            encode(tape_time_us(2'000), event::HalfClose{Side::driver}) +
                                            encode(tape_time_us(4'000), event::HalfClose{Side::device}) +
                                            encode(tape_time_us(9'000'000), event::DeviceLost{"", true})));
  log.peer_half_closes = true;
  start();
  const Instant asked = loop.now();
  write("ask");
  const auto due = port->waiting()->next_due();
  ASSERT_TRUE(due.has_value());
  EXPECT_GT(*due - asked, std::chrono::milliseconds(500)) << "patience";
  EXPECT_TRUE(port->end_writing());
  run_until(loop, [this] { return log.events.find("hung_up") != std::string::npos; });
  EXPECT_EQ(log.data, "answer");
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0) << book.text();
}

TEST_F(ReplayPortTest, TheDevicesHalfCloseIsToldBehindItsBytes) {
  test::write_file(dir / "t.logr", test::block_bytes({{1'000, "hello"}}));
  test::write_file(dir / "t.logw", test::block_bytes({{5'000, "bye"}}));
  test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                            encode(tape_time_us(2'000), event::HalfClose{Side::device})));
  log.peer_half_closes = true;
  start();
  run_until(loop, [this] { return log.events == "up ended "; });
  EXPECT_EQ(log.data, "hello");
  write("bye");
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0) << book.text();
}

TEST_F(ReplayPortTest, ThatNobodyCameIsIncompleteAndTold) {
  test::write_file(dir / "t.logr", test::block_bytes({{0, "one"}}));
  start(dir / "report.json", OnMismatch::fail, false);
  (void)finish();
  EXPECT_EQ(log.status, 5);
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))),
              HasSubstr(R"("runs":{"count":0,"looks":0,"worst":"incomplete","list":[]})"));
  EXPECT_THAT(book.text(), HasSubstr("nobody has opened the port"));
}

TEST_F(ReplayPortTest, ALookDoesNotEndAReplayThatRunsOnce) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  once = true;
  start();
  port->close();
  EXPECT_EQ(log.events, "up ");
  port->open();
  write("one");
  port->close();
  EXPECT_EQ(log.events, "up up finished0 ");
  (void)finish();
  EXPECT_EQ(log.status, 0);
}

TEST_F(ReplayPortTest, AReportThatCannotBeWrittenIsAFailure) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  std::filesystem::create_directory(dir / "sub");
  start((dir / "sub") + "/report.json");
  write("one");
  std::filesystem::remove(dir / "sub");
  (void)finish();
  EXPECT_EQ(log.status, 1);
}

// Two files of 1.5 GiB of empty blocks each, which take longer to count than anybody waits.
class TapeOfEmptyBlocks : public ReplayPortTest {
 protected:
  TapeOfEmptyBlocks() {
    for (const char* file : {"t.logr", "t.logw"}) {
      test::write_file(dir / file, ByteView{});
      std::filesystem::resize_file(dir / file, std::uintmax_t{3} << 29);
    }
  }
  void expect_not_counted() {
    EXPECT_EQ(log.status, 1);
    ASSERT_TRUE(port->report().has_value());
    EXPECT_EQ(port->report()->to_driver_of, std::nullopt);
    EXPECT_THAT(port->report()->trouble.value_or(""), HasSubstr("not counted in time"));
  }
};

TEST_F(TapeOfEmptyBlocks, HoldsNothingUp) {
  start();
  for (int i = 0; i < 50; ++i) {
    const Instant begin = loop.now();
    write("hello");
    loop.poll_one();
    EXPECT_WITHIN(loop.now() - begin, std::chrono::milliseconds(500));
  }
  port->close();
  EXPECT_WITHIN(finish(), std::chrono::milliseconds(1500))
      << "counting gives way to an end that is asked for";
  expect_not_counted();
}

TEST_F(TapeOfEmptyBlocks, IsCountedForSomeSecondsWhereTheRunItselfIsTheEnd) {
  ends_with_run = true;
  start();
  write("hello");
  port->close();
  const Nanos took = finish();
  EXPECT_GE(took, std::chrono::seconds(3));
  EXPECT_WITHIN(took, std::chrono::seconds(8));
  expect_not_counted();
}

// Tapes whose zeros were 40 s apart, each with a read an hour after its zero.
TEST_F(ReplayPortTest, TapesOfOneProgramPlayByItsClock) {
  const auto clock = std::make_shared<ReplayClock>(1);
  const auto play = [&](const char* tape, std::int64_t zero_us) {
    TapeHeader header;
    header.zero = TapeZero{"2024-01-01T00:00:00Z", zero_us, "a boot"};
    test::write_file(dir / (std::string(tape) + "e"), as_bytes(encode(header)));
    test::write_file(dir / (std::string(tape) + "r"), test::block_bytes({{3'600'000'000, "x"}}));
    ReplayOptions options;
    options.tape = literal_tape(dir / tape);
    options.config.timing = Timing::recorded;
    auto made = std::make_unique<ReplayedDevice>(
        PortContext{.loop = &loop, .log = book.log(), .replay_clock = clock}, std::move(options));
    made->listen(log);
    EXPECT_TRUE(made->prepare().has_value());
    return made;
  };
  const auto first = play("1.log", 5'000'000);
  const auto second = play("2.log", 45'000'000);
  first->open();
  second->open();
  const auto due = first->waiting()->next_due();
  const auto later = second->waiting()->next_due();
  ASSERT_TRUE(due && later);
  EXPECT_EQ(*later - *due, std::chrono::seconds(40));
  first->close();
  EXPECT_TRUE(clock->runs());
  second->close();
  EXPECT_FALSE(clock->runs());
}

}  // namespace
}  // namespace porttape
