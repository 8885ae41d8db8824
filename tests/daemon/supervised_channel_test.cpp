// A channel in trouble: a replay whose tape comes late, on a loop whose clock the test moves.

#include "daemon/supervised_channel.hpp"

#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;
using testing::Not;

std::size_t count_of(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += what.size()) ++count;
  return count;
}

class SupervisedChannelTest : public testing::Test {
 protected:
  std::unique_ptr<SupervisedChannel> make(bool retries) {
    return std::make_unique<SupervisedChannel>(
        PortContext{&loop, book.log()},
        ChannelSpec{ChannelMode::replay,
                    {{"driver", "unix-listen:" + (dir / "socket")}, {"tape", dir / "laser.log"}}},
        retries, [this](int status) { ended.push_back(status); });
  }
  void write_tape() const {
    test::MemoryTape tape;
    tape.open(0).write(10, "ask").read(20, "answer").close(30);
    test::write_tape(literal_tape(dir / "laser.log"), tape);
  }

  test::TempDir dir;
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  std::vector<int> ended;
};

TEST_F(SupervisedChannelTest, WithoutRetriesTheFirstTroubleIsTheEnd) {
  const auto channel = make(false);
  const Result<void> started = channel->start();
  ASSERT_FALSE(started);
  EXPECT_THAT(started.error().message, HasSubstr("laser.log"));
  settle(loop);
  EXPECT_TRUE(ended.empty()) << "the error is the end";
  EXPECT_FALSE(loop.next_timer().has_value());
}

TEST_F(SupervisedChannelTest, ItIsTriedAgainLaterAndLater) {
  const auto channel = make(true);
  ASSERT_TRUE(channel->start());
  for (const int delay : {1, 2, 4, 8, 16, 30, 30}) {
    ASSERT_TRUE(loop.next_timer().has_value());
    EXPECT_EQ(*loop.next_timer() - clock.now(), seconds(delay));
    EXPECT_EQ(channel->status().retry_in, seconds(delay));
    let_pass(loop, clock, seconds(delay));
  }
  EXPECT_EQ(count_of(book.text(), "trying again"), 1U) << book.text();
  EXPECT_THAT(book.text(), HasSubstr("trying again after 1 s and longer"));
  EXPECT_TRUE(ended.empty());
}

TEST_F(SupervisedChannelTest, ItsStatusSaysWhatIsMissing) {
  const auto channel = make(true);
  ASSERT_TRUE(channel->start());
  let_pass(loop, clock, milliseconds(400));
  const ChannelStatus status = channel->status();
  EXPECT_EQ(status.mode, "replay");
  EXPECT_TRUE(status.lines.empty());
  EXPECT_EQ(status.retry_in, milliseconds(600));
  EXPECT_THAT(status.why, HasSubstr("laser.log"));
  for (const Result<void>& refused :
       {channel->request(RecorderRequest::next_tape()), channel->request(PlaybackRequest{})}) {
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, Errc::usage);
    EXPECT_THAT(refused.error().message, testing::StartsWith("the channel is in trouble: "));
    EXPECT_THAT(refused.error().message, HasSubstr("laser.log"));
  }
}

TEST_F(SupervisedChannelTest, OnceTheTroubleIsOverItRuns) {
  const auto channel = make(true);
  ASSERT_TRUE(channel->start());
  write_tape();
  let_pass(loop, clock, seconds(1));
  EXPECT_THAT(book.text(), HasSubstr("the channel has been started again"));
  EXPECT_TRUE(std::filesystem::exists(dir / "socket"));
  const ChannelStatus status = channel->status();
  ASSERT_EQ(status.lines.size(), 1U);
  EXPECT_EQ(status.lines.front().state, Session::State::waiting);
  EXPECT_FALSE(status.retry_in.has_value());
  EXPECT_EQ(status.why, "");
  const Result<void> refused = channel->request(RecorderRequest::next_tape());
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, Not(HasSubstr("in trouble")));
  channel->stop();
  settle(loop);
  EXPECT_EQ(ended, std::vector<int>{exit_status::kIncomplete}) << "no driver came, which is a verdict";
}

TEST_F(SupervisedChannelTest, AStopEndsOneThatWaitsForItsNextTry) {
  const auto channel = make(true);
  ASSERT_TRUE(channel->start());
  channel->stop();
  EXPECT_TRUE(ended.empty()) << "the end comes from the loop";
  settle(loop);
  EXPECT_EQ(ended, std::vector<int>{0});
  EXPECT_FALSE(loop.next_timer().has_value());
  channel->stop();
  let_pass(loop, clock, seconds(60));
  EXPECT_EQ(ended, std::vector<int>{0}) << "once";
}

TEST_F(SupervisedChannelTest, OneThatGoesHearsNoMore) {
  auto channel = make(true);
  ASSERT_TRUE(channel->start());
  channel->stop();
  channel.reset();
  settle(loop);
  EXPECT_TRUE(ended.empty());
}

}  // namespace
}  // namespace porttape
