// The replaying port: what it does off the loop, and when its end is told.

#include "libport/taped/replay_port.hpp"

#include <filesystem>
#include <memory>
#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/budget.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/tape/block.hpp"
#include "libport/tape/event.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/support/time_bound.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

class ReplayPortTest : public testing::Test {
 protected:
  void start(const std::string& report = {}, OnMismatch on_mismatch = OnMismatch::fail, bool open = true) {
    ReplayPort::Options options;
    options.tape = literal_tape(dir / "t.log");
    options.config.on_mismatch = on_mismatch;
    options.config.match = match;
    options.config.chunks = chunks;
    options.report_file = report;
    options.once = once;
    options.looks_on = looks_on;
    options.session = session;
    port = std::make_unique<ReplayPort>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
    if (open) port->open();
  }
  void write(std::string_view text) { port->write(as_bytes(text)); }
  // How long it took until finish() was done.
  Nanos finish() {
    const Instant begin = loop.now();
    port->finish();
    run_until(loop, [this] { return log.status.has_value(); });
    return loop.now() - begin;
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  PortLog log;
  bool once = false;
  bool looks_on = false;
  std::uint64_t session = 0;
  Match match = Match::sequence;
  Chunks chunks = Chunks::automatic;
  std::unique_ptr<ReplayPort> port;
};

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

TEST_F(ReplayPortTest, FilesThatAreNotWhatTheEndTellsAreNotPlayed) {
  const auto events = [&](const event::End& end) {
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{}) + encode(tape_time_us(0), event::Open{}) +
                                              encode(tape_time_us(50), end)));
  };
  const auto said = [&] {
    ReplayPort::Options options;
    options.tape = literal_tape(dir / "t.log");
    ReplayPort other(PortContext{&loop, book.log()}, std::move(options));
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
  events({});
  test::write_file(dir / "t.logw", {});
  EXPECT_EQ(said(), "plays") << "an end that tells nothing of the files";
}

TEST_F(ReplayPortTest, AnEndThatIsMissingIsADoubt) {
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
  port->faulted({.kind = "plan", .spec = "drop:p=1", .seed = 7});
  port->faulted({.kind = "drop", .spec = "drop:byte=3:dir=r", .dir = LineDir::r, .offset = 3});
  port->faulted({.kind = "more", .count = 4});
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
  ReplayPort::Options options;
  options.tape = literal_tape(dir / "t.log");
  options.config.chunks = Chunks::random;
  ReplayPort other(PortContext{&loop, book.log()}, std::move(options));
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
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))),
              HasSubstr(R"("lookup":{"requests":2,"asked":2,"answered":3,"unknown":0,"never_asked":[]})"));
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
  ReplayPort::Options options;
  options.tape = literal_tape(dir / "t.log");
  options.session = 3;
  ReplayPort other(PortContext{&loop, book.log()}, std::move(options));
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

// Two files of 1.5 GiB of empty blocks each: nobody waits for them.
TEST_F(ReplayPortTest, ATapeOfEmptyBlocksHoldsNothingUp) {
  for (const char* file : {"t.logr", "t.logw"}) {
    test::write_file(dir / file, ByteView{});
    std::filesystem::resize_file(dir / file, std::uintmax_t{3} << 29);
  }
  start();
  for (int i = 0; i < 50; ++i) {
    const Instant begin = loop.now();
    write("hello");
    loop.poll_one();
    EXPECT_WITHIN(loop.now() - begin, std::chrono::milliseconds(500));
  }
  port->close();
  EXPECT_WITHIN(finish(), std::chrono::seconds(8));
  EXPECT_EQ(log.status, 1);
  ASSERT_TRUE(port->report().has_value());
  EXPECT_EQ(port->report()->to_driver_of, std::nullopt);
  EXPECT_THAT(port->report()->trouble.value_or(""), HasSubstr("not counted in time"));
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
    ReplayPort::Options options;
    options.tape = literal_tape(dir / "t.log");
    ReplayPort made(PortContext{&loop, book.log()}, std::move(options));
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

// Tapes whose zeros were 40 s apart, each with a read an hour after its zero.
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

TEST_F(ReplayPortTest, TapesOfOneProgramPlayByItsClock) {
  const auto clock = std::make_shared<ReplayClock>(1);
  const auto play = [&](const char* tape, std::int64_t zero_us) {
    TapeHeader header;
    header.zero = TapeZero{"2024-01-01T00:00:00Z", zero_us, "a boot"};
    test::write_file(dir / (std::string(tape) + "e"), as_bytes(encode(header)));
    test::write_file(dir / (std::string(tape) + "r"), test::block_bytes({{3'600'000'000, "x"}}));
    ReplayPort::Options options;
    options.tape = literal_tape(dir / tape);
    options.config.timing = Timing::recorded;
    auto made = std::make_unique<ReplayPort>(
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

// What is due waits for a driver that does not read; what comes next waits for its question.
class FlushOfATape : public ReplayPortTest {
 protected:
  std::string left_after(FlushQueue queue) {
    test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}, {5'000, "more"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}, {5'001, "new"}}));
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{})));
    log.data.clear();
    start();
    port->set_reading(false);
    write("ask");
    run_until(loop, [begin = loop.now(), this] {
      loop.post([] {});
      return loop.now() - begin > std::chrono::milliseconds(5);
    });
    port->peer_flushed(queue);
    port->set_reading(true);
    write("more");
    run_until(loop, [this] { return log.data.ends_with("new"); });
    port->close();
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
  for (int i = 0; i < 10'000; ++i) port->peer_flushed(FlushQueue::both);
  EXPECT_EQ(book.text(), before);
}

// Bytes that the driver dropped before they were read may be wrong or right.
class OutputFlushes : public ReplayPortTest {
 protected:
  // Of a driver that writes twice and drops its output behind the writes that the tape has a flush for.
  void record(bool first, bool second) {
    test::MemoryTape tape;
    tape.open(0).event(1, event::Flush{event::Flush::Queue::both}).write(10, "one");
    if (first) tape.event(20, event::Flush{event::Flush::Queue::out});
    tape.write(30, "two");
    if (second) tape.event(40, event::Flush{event::Flush::Queue::both});
    tape.close(50);
    test::write_tape(literal_tape(dir / "t.log"), tape, {.device = "d", .driver = "p"});
  }
  // Of one that does so behind each.
  std::vector<std::string> doubts() {
    log.status.reset();
    start();
    port->peer_flushed(FlushQueue::both);
    write("one");
    port->peer_flushed(FlushQueue::in);
    port->peer_flushed(FlushQueue::out);
    port->peer_flushed(FlushQueue::out);
    write("two");
    port->peer_flushed(FlushQueue::both);
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

TEST_F(OutputFlushes, OftenerThanOnTheTapeAreADoubt) {
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

TEST_F(ReplayPortTest, WhoWasTurnedAwayIsADoubt) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  const auto doubts = [this](std::vector<std::uint64_t> others) {
    log.status.reset();
    start();
    write("one");
    for (const std::uint64_t bytes : others) port->peer_refused(bytes);
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

// What is unread at the driver's close.
class UnreadOfATape : public ReplayPortTest {
 protected:
  UnreadOfATape() { test::write_file(dir / "t.logr", test::block_bytes({{0, "hello"}})); }
  void listen_and_leave(std::uint64_t unread) {
    start();
    run_until(loop, [this] { return log.data == "hello"; });
    port->peer_left_unread(unread);
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

TEST_F(UnreadOfATape, IsNothingThatTheDriverFlushed) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}, {5'000, "more"}}));
  test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}, {5'001, "new"}}));
  test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{})));
  start();
  port->set_reading(false);
  write("ask");
  run_until(loop, [begin = loop.now(), this] {
    loop.post([] {});
    return loop.now() - begin > std::chrono::milliseconds(5);
  });
  port->peer_flushed(FlushQueue::in);
  port->set_reading(true);
  write("more");
  run_until(loop, [this] { return log.data == "new"; });
  port->close();
  (void)finish();
  EXPECT_EQ(port->report()->reads_excused, 3U);
  EXPECT_EQ(port->report()->unread, std::nullopt);
}

TEST_F(ReplayPortTest, AFlushOfATapeWithoutEventsDropsNothingThatItsDriverRead) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}}));
  test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}}));
  start();
  port->set_reading(false);
  write("ask");
  port->peer_flushed(FlushQueue::both);
  port->set_reading(true);
  run_until(loop, [this] { return log.data == "old"; });
}

// A tape whose device has 1200 baud; its driver asks for 300, which it takes, 7, which it refuses, and 150,
// for which it takes 134.
class SettingsOfATape : public ReplayPortTest {
 protected:
  SettingsOfATape() {
    const auto by = [](Side side, unsigned baud) {
      return event::Settings{side, {.baud = baud, .stop_bits = 1}, SettingsOrder::exact};
    };
    write_events(
        encode(tape_time_us(0), event::Open{}) +
        encode(tape_time_us(1), event::Settings{Side::device, SeenSettings::of({.baud = 1200}), {}}) +
        encode(tape_time_us(100'000), by(Side::driver, 300)) +
        encode(tape_time_us(200'000), by(Side::driver, 7)) +
        encode(tape_time_us(200'001), by(Side::device, 300)) +
        encode(tape_time_us(300'000), by(Side::driver, 150)) +
        encode(tape_time_us(300'001), by(Side::device, 134)) + encode(tape_time_us(400'000), event::Close{}) +
        encode(tape_time_us(500'000), event::Open{}) + encode(tape_time_us(600'000), by(Side::driver, 300)) +
        encode(tape_time_us(700'000), event::Close{}));
  }
  void write_events(const std::string& events, const std::string& device = "serial:/dev/ttyUSB0") {
    test::write_file(dir / "t.logr", test::block_bytes({{0, "a"}, {650'000, "b"}}));
    test::write_file(dir / "t.loge",
                     as_bytes(encode(TapeHeader{.device = device, .driver = "pty:"}) + events));
  }
  // As a session does it.
  Result<void> set(unsigned baud) {
    const SeenSettings seen{.baud = baud};
    port->peer_set(seen, SettingsOrder::sampled);
    return port->apply(seen.over(*port->settings()));
  }
  unsigned baud() { return port->settings().value().baud; }
};

TEST_F(SettingsOfATape, AreThoseOfItsDevice) {
  start();
  EXPECT_EQ(port->settings(), LineSettings{.baud = 1200});
  EXPECT_TRUE(set(300).has_value());
  EXPECT_EQ(baud(), 300U);
  EXPECT_EQ(log.events, "up ");
  const Result<void> refused = set(7);
  ASSERT_FALSE(refused.has_value());
  EXPECT_THAT(refused.error().message, HasSubstr("on the tape the device did not take 7 baud, 8N1"));
  EXPECT_EQ(baud(), 300U);
  EXPECT_TRUE(set(150).has_value());
  EXPECT_EQ(baud(), 134U);
  EXPECT_EQ(log.events, "up settings ");
  EXPECT_EQ(log.settings.baud, 134U);
  port->close();
  EXPECT_EQ(baud(), 1200U) << "its own again";
}

TEST_F(SettingsOfATape, AreThoseThatHoldWhereASessionBegins) {
  session = 2;
  start();
  EXPECT_EQ(baud(), 1200U);
}

TEST_F(SettingsOfATape, AnOlderRecordersAreTheOptionsItOpenedTheDeviceWith) {
  write_events({}, "serial:/dev/ttyUSB0,alwaysopen,baud=57600,parity=even");
  start();
  EXPECT_EQ(port->settings(), (LineSettings{.baud = 57600, .parity = Parity::even}));
}

TEST_F(SettingsOfATape, WhereNothingTellsOfThemThereAreNone) {
  for (const char* device : {"tcp:localhost:1,baud=3", "serial:/dev/ttyUSB0,baud=much", ""}) {
    write_events({}, device);
    start();
    EXPECT_EQ(port->settings(), std::nullopt) << device;
    EXPECT_FALSE(port->apply({}).has_value());
  }
}

TEST_F(SettingsOfATape, TheDriversAreHeldAgainstIt) {
  once = true;
  start(dir / "report.json");
  (void)set(300);
  (void)set(150);
  port->close();
  port->open();
  (void)set(300);
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  const std::string file(as_text(test::read_file(dir / "report.json")));
  EXPECT_THAT(file, HasSubstr(R"("settings":{"recorded":4,"made":3,)"
                              R"("missing":[{"tape_us":200000,"baud":7,"stopbits":1}],"checked":false})"));
  EXPECT_THAT(book.text(), HasSubstr("the driver never made its line 7 baud, 1 stop bit"));
}

// An answer between two changes of the device's, and a drain of the driver's.
class SignalsOfATape : public ReplayPortTest {
 protected:
  SignalsOfATape() {
    const auto by_device = [](std::int64_t us, LineSignal::Name name, bool on) {
      return encode(tape_time_us(us), signal_event({Side::device, {name, on}}));
    };
    const std::string events =
        encode(TapeHeader{.device = "serial:/dev/x", .driver = "pty"}) +
        encode(tape_time_us(0), event::Open{}) + by_device(10, LineSignal::Name::cts, true) +
        encode(tape_time_us(1'100), event::Drain{Micros{5'000}}) +
        by_device(3'000, LineSignal::Name::cts, false) + encode(tape_time_us(9'000), event::Close{});
    test::write_file(dir / "t.loge", as_bytes(events));
    test::write_file(dir / "t.logw", test::block_bytes({{1'000, "ask"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{2'000, "one"}, {4'000, "two"}}));
  }
};

TEST_F(SignalsOfATape, AreToldInTheirPlaceWhereTheyAreWanted) {
  start({}, OnMismatch::fail, false);
  port->watch_signals(true);
  port->open();
  EXPECT_EQ(log.events, "up cts+ ");
  write("ask");
  run_until(loop, [this] { return log.data == "onetwo"; });
  EXPECT_EQ(log.events, "up cts+ cts- ");
  EXPECT_EQ(log.signals_after, (std::vector<std::size_t>{0, 3}));
}

TEST_F(SignalsOfATape, AreNotToldWhereNobodyLooks) {
  start();
  write("ask");
  run_until(loop, [this] { return log.data == "onetwo"; });
  EXPECT_EQ(log.events, "up ");
}

TEST_F(SignalsOfATape, ADrainLastsAsLongAsItsRecordedOne) {
  start();
  const Instant begin = loop.now();
  int sent = 0;
  port->drain([&sent] { ++sent; });
  EXPECT_EQ(sent, 0);
  run_until(loop, [&sent] { return sent > 0; });
  EXPECT_GE(loop.now() - begin, std::chrono::milliseconds(5));
  port->drain([&sent] { ++sent; });
  EXPECT_EQ(sent, 2) << "the tape has no other";
}

TEST_F(SignalsOfATape, ADrainEndsWithTheLine) {
  start();
  int sent = 0;
  port->drain([&sent] { ++sent; });
  port->close();
  EXPECT_EQ(sent, 1);
}

}  // namespace
}  // namespace porttape
