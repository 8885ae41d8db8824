// The replaying port: what it does off the loop, and when its end is told.

#include "libport/taped/replay_port.hpp"

#include <filesystem>
#include <memory>
#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/replay_clock.hpp"
#include "libport/tape/event.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

class ReplayPortTest : public testing::Test {
 protected:
  void start(const std::string& report = {}, OnMismatch on_mismatch = OnMismatch::fail, bool open = true) {
    ReplayPort::Options options;
    options.tape = literal_tape(dir / "t.log");
    options.config.on_mismatch = on_mismatch;
    options.report_file = report;
    options.once = once;
    options.session = session;
    port = std::make_unique<ReplayPort>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
    if (open) port->open();
  }
  void write(std::string_view text) { port->write(as_bytes(text)); }
  // How long it took until finish() was done.
  Nanos finish() {
    const Instant begin = Loop::now();
    port->finish();
    run_until(loop, [this] { return log.status.has_value(); });
    return Loop::now() - begin;
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  PortLog log;
  bool once = false;
  std::uint64_t session = 0;
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

TEST_F(ReplayPortTest, TheReportFileIsThereWhenTheEndIsTold) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "one"}}));
  start(dir / "report.json");
  write("one");
  port->close();
  (void)finish();
  EXPECT_EQ(log.status, 0);
  EXPECT_THAT(std::string(as_text(test::read_file(dir / "report.json"))), HasSubstr(R"("verdict":"pass")"));
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
                              encode(tape_time_us(105'000), event::Close{})));
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
  write("ask");
  const auto due = port->waiting()->next_due();
  ASSERT_TRUE(due.has_value());
  EXPECT_GT(*due - Loop::now(), std::chrono::milliseconds(500)) << "patience";
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
    const Instant begin = Loop::now();
    write("hello");
    loop.poll_one();
    EXPECT_LT(Loop::now() - begin, std::chrono::milliseconds(500));
  }
  port->close();
  EXPECT_LT(finish(), std::chrono::seconds(8));
  EXPECT_EQ(log.status, 1);
  ASSERT_TRUE(port->report().has_value());
  EXPECT_EQ(port->report()->to_driver_of, std::nullopt);
  EXPECT_THAT(port->report()->trouble.value_or(""), HasSubstr("not counted in time"));
}

// Tapes whose zeros were 40 s apart, each with a read an hour after its zero.
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
  loop.post([begin = Loop::now()] {
    while (Loop::now() - begin < std::chrono::milliseconds(60)) {
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

TEST_F(ReplayPortTest, AFlushOfTheDriverDropsWhatIsDueAndUnread) {
  test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}}));
  test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}}));
  test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{})));
  start();
  port->set_reading(false);
  write("ask");
  run_until(loop, [begin = Loop::now(), this] {
    loop.post([] {});
    return Loop::now() - begin > std::chrono::milliseconds(5);
  });
  port->peer_flushed(FlushQueue::out);
  port->peer_flushed(FlushQueue::in);
  port->set_reading(true);
  EXPECT_EQ(log.data, "");
  (void)finish();
  EXPECT_EQ(log.status, 0);
}

}  // namespace
}  // namespace porttape
