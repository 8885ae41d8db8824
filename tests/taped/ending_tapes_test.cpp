#include "libport/taped/ending_tapes.hpp"

#include <cerrno>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

class EndingTapesTest : public testing::Test {
 protected:
  // A tape of what was kept so far, as one who watches a line saves it.
  std::unique_ptr<LiveTape> tape(const std::string& name) {
    LiveTape::Options options{
        .paths = literal_tape(dir / name), .header = {"device", "driver"}, .on_news = ending.news()};
    options.fill = [](TapeWriter& writer) { writer.read_block(tape_time_us(1), as_bytes("kept")); };
    return std::make_unique<LiveTape>(loop.workers(), nullptr, std::move(options));
  }
  bool wait_for_end() {
    std::optional<bool> end;
    ending.when_over([&end](bool complete) { end = complete; });
    run_until(loop, [&end] { return end.has_value(); });
    return *end;
  }
  bool told(std::string_view text) { return book.text().find(text) != std::string::npos; }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  int news = 0;
  EndingTapes ending{{&loop, book.log()}, [this] { ++news; }};
};

TEST_F(EndingTapesTest, NoneIsOverAtOnce) {
  std::optional<bool> end;
  ending.when_over([&end](bool complete) { end = complete; });
  EXPECT_EQ(end, true);
}

TEST_F(EndingTapesTest, EachIsToldAndTheEndComesWithTheLast) {
  ending.finish(tape("one.log"), tape_time_us(2));
  ending.finish(tape("two.log"), tape_time_us(2));
  EXPECT_TRUE(wait_for_end());
  EXPECT_TRUE(told("one.log is complete: 4 bytes")) << book.text();
  EXPECT_TRUE(told("two.log is complete: 4 bytes")) << book.text();
  EXPECT_GT(news, 0);
  auto reader = TapeReader::open(literal_tape(dir / "two.log"));
  ASSERT_TRUE(reader.has_value());
  EXPECT_EQ(test::read_all(*reader), (std::vector<std::string>{"r 1 kept", "end 2"}));
}

TEST_F(EndingTapesTest, OneThatIsMissingIsToldAndTheEndIsNotComplete) {
  auto missing = tape("no folder/one.log");
  missing->block(Direction::read, tape_time_us(2), as_bytes("seven b"));
  ending.finish(std::move(missing), tape_time_us(3));
  ending.finish(tape("two.log"), tape_time_us(3));
  EXPECT_FALSE(wait_for_end());
  EXPECT_TRUE(told("7 bytes passed and are on no tape")) << book.text();
  EXPECT_TRUE(told("two.log is complete")) << book.text();
}

TEST_F(EndingTapesTest, GivenUpTheyTellWhatIsMissingAndNoEndComes) {
  auto reached = std::make_shared<std::promise<std::function<void()>>>();
  auto goes_on = std::make_shared<std::promise<void>>();
  LiveTape::Options options{.paths = literal_tape("hung.log"),
                            .header = {"device", "driver"},
                            .on_news = ending.news(),
                            .make = [reached, goes_on](const LiveTape::Options& given) -> Result<TapeWriter> {
                              reached->set_value(given.on_news);
                              goes_on->get_future().wait();
                              return make_error(Errc::io, "a test wants it");
                            }};
  auto hung = std::make_unique<LiveTape>(loop.workers(), nullptr, std::move(options));
  hung->block(Direction::write, tape_time_us(1), as_bytes("four"));
  ending.finish(std::move(hung), tape_time_us(2));
  std::optional<bool> end;
  ending.when_over([&end](bool complete) { end = complete; });
  ending.give_up();
  EXPECT_TRUE(told("hung.log: its disk did not answer in time; 4 bytes and the end are not on it"))
      << book.text();
  reached->get_future().get()();  // news of it all the same
  run_until(loop, [this] { return news > 0; });
  EXPECT_EQ(end, std::nullopt);
  goes_on->set_value();
}

// Takes everything and cannot sync.
class UnsafeSink final : public TapeSink {
 public:
  Appended append(ByteView head, ByteView body) override { return {head.size() + body.size(), 0}; }
  int truncate(std::uint64_t) override { return 0; }
  Sync syncer() override {
    return [] { return EIO; };
  }
  int close() override { return 0; }
};

TEST_F(EndingTapesTest, AFailedSyncIsToldUnlessItWas) {
  int errors = 0;
  EndingTapes strict({&loop, book.log()}, {}, [&errors] { ++errors; });
  for (const bool told_before : {false, true}) {
    LiveTape::Options options{.paths = literal_tape("unsafe.log"), .header = {"device", "driver"}};
    options.on_news = strict.news();
    options.make = [](const LiveTape::Options& given) {
      return TapeWriter::on_sinks(
          {std::make_unique<UnsafeSink>(), std::make_unique<UnsafeSink>(), std::make_unique<UnsafeSink>()},
          given.header, {.sync = false});
    };
    auto unsafe = std::make_unique<LiveTape>(loop.workers(), nullptr, std::move(options));
    unsafe->block(Direction::read, tape_time_us(1), as_bytes("data"));
    while (unsafe->status().sync_error == 0) std::this_thread::yield();
    strict.finish(std::move(unsafe), tape_time_us(2), {told_before});
    std::optional<bool> end;
    strict.when_over([&end](bool complete) { end = complete; });
    run_until(loop, [&end] { return end.has_value(); });
    EXPECT_EQ(errors, 1);
    EXPECT_EQ(end, false);
  }
  EXPECT_TRUE(told("what was written may not be on the disk: Input/output error")) << book.text();
}

TEST_F(EndingTapesTest, OnlyATapeThatIsMadeIsToldToHaveEnded) {
  std::vector<std::string> ended;
  EndingTapes each({&loop, book.log()}, {}, {},
                   [&ended](const TapePaths& paths) { ended.push_back(paths.name()); });
  for (const std::string name : {"one.log", "no folder/two.log"}) {
    LiveTape::Options options{
        .paths = literal_tape(dir / name), .header = {"device", "driver"}, .on_news = each.news()};
    each.finish(std::make_unique<LiveTape>(loop.workers(), nullptr, std::move(options)), tape_time_us(2));
  }
  std::optional<bool> end;
  each.when_over([&end](bool complete) { end = complete; });
  run_until(loop, [&end] { return end.has_value(); });
  EXPECT_EQ(end, false);
  EXPECT_EQ(ended, std::vector<std::string>{dir / "one.log"});
}

TEST(EndingTapesText, SaysHowMuchIsMissingAndWhy) {
  EXPECT_EQ(missed_text(0, "why"), "why");
  EXPECT_EQ(missed_text(1, "why"), "1 bytes passed and are on no tape: why");
  LiveTape::Status status;
  status.paths = literal_tape("t.log");
  status.sync_error = EIO;
  EXPECT_EQ(sync_error_text(status),
            "tape t.log: what was written may not be on the disk: Input/output error");
  status.sync_error = ENOENT;
  EXPECT_EQ(sync_error_text(status),
            "tape t.log: what was written may not be on the disk: its files were removed; SIGUSR1 begins the "
            "next tape");
}

}  // namespace
}  // namespace porttape
