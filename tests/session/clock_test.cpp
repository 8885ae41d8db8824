// A session whose loop has a clock that the test moves: hours pass as fast as the work in them is done.

#include <chrono>
#include <fmt/format.h>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "libport/session/session.hpp"
#include "libport/taped/replayed_device.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

constexpr int kQuestions = 60;
constexpr Nanos kAnswered = milliseconds(40);
constexpr Nanos kAll = hours(1);

// A question each minute of an hour, on a tape, and the driver that asks them again.
class HourOfQuestions {
 public:
  struct Outcome {
    std::string answers;
    std::optional<RunReport> report;
    std::optional<int> status;
  };

  HourOfQuestions(Loop& loop, double rate, ReplayConfig config) : loop_(&loop), rate_(rate) {
    test::MemoryTape tape;
    tape.open(0);
    for (int n = 0; n < kQuestions; ++n) {
      const auto at = std::chrono::duration_cast<Micros>(minutes(n) + seconds(1)).count();
      tape.write(at, question(n));
      tape.read(at + std::chrono::duration_cast<Micros>(kAnswered).count(), answer(n));
    }
    tape.close(std::chrono::duration_cast<Micros>(kAll).count());
    config.rate = rate;
    ReplayOptions options;
    options.tape = test::write_tape(literal_tape(dir_ / "hour.log"), tape);
    options.config = config;
    options.once = true;
    options.on_report = [this](const RunReport& report) { outcome_.report = report; };
    const PortContext context{&loop, book_.log()};
    driver_.passive = true;
    driver_.up_at_once = false;
    session_ = std::make_unique<Session>(context, std::make_unique<MemoryPort>(driver_),
                                         std::make_unique<ReplayedDevice>(context, std::move(options)),
                                         [this](int status) { outcome_.status = status; });
  }

  // The question that the driver asks so much later than recorded.
  void delay(int question, Nanos by) {
    late_ = question;
    late_by_ = by;
  }

  // `run` runs the loop until what it is given holds.
  Outcome play(const std::function<void(const std::function<bool()>&)>& run) {
    EXPECT_TRUE(session_->start().has_value());
    begin_ = loop_->now();
    driver_.up();
    wait_for_next();
    run([this] { return outcome_.status.has_value(); });
    outcome_.answers = driver_.written;
    return outcome_;
  }

  static std::string question(int n) { return fmt::format("how much at {}?\n", n); }
  static std::string answer(int n) { return fmt::format("{} litres\n", n * n); }
  static std::string all_answers() {
    std::string all;
    for (int n = 0; n < kQuestions; ++n) all += answer(n);
    return all;
  }

 private:
  [[nodiscard]] Instant at(Nanos since_begin) const {
    return begin_ + Nanos(static_cast<Nanos::rep>(static_cast<double>(since_begin.count()) / rate_));
  }
  void wait_for_next() {
    const Nanos when = asked_ < kQuestions ? Nanos(minutes(asked_) + seconds(1)) : kAll;
    timer_.set(at(when + (asked_ == late_ ? late_by_ : Nanos(0))));
  }
  void on_time() {
    if (asked_ == kQuestions) return driver_.down(LineDown::Reason::closed);
    driver_.send(question(asked_++));
    wait_for_next();
  }

  Loop* loop_;
  double rate_;
  test::TempDir dir_;
  LogBook book_;
  MemoryPort::Peer driver_;
  Outcome outcome_;
  Instant begin_{};
  int asked_ = 0;
  int late_ = -1;
  Nanos late_by_{};
  Timer timer_{*loop_, [this] { on_time(); }};
  std::unique_ptr<Session> session_;
};

HourOfQuestions::Outcome by_moved_clock(Timing timing, int late = -1, Nanos late_by = {}) {
  ManualClock clock;
  Loop loop(clock);
  HourOfQuestions hour(loop, 1, {.strictness = 2, .timing = timing});
  hour.delay(late, late_by);
  const Instant begin = clock.now();
  const HourOfQuestions::Outcome outcome = hour.play([&](const std::function<bool()>& done) {
    EXPECT_TRUE(let_pass(loop, clock, kAll + minutes(1), done));
  });
  EXPECT_GE(clock.now() - begin, kAll);
  return outcome;
}

class AnHourOfReplay : public testing::TestWithParam<Timing> {};
INSTANTIATE_TEST_SUITE_P(Timings, AnHourOfReplay, testing::Values(Timing::reactive, Timing::recorded),
                         [](const auto& of) {
                           return of.param == Timing::reactive ? "reactive" : "recorded";
                         });

TEST_P(AnHourOfReplay, GivesTheBytesAndTheVerdictOfRealTime) {
  const HourOfQuestions::Outcome moved = by_moved_clock(GetParam());
  ASSERT_TRUE(moved.report && moved.status);
  EXPECT_EQ(moved.answers, HourOfQuestions::all_answers());
  EXPECT_EQ(moved.report->verdict, Verdict::pass);
  EXPECT_EQ(moved.status, 0);
  EXPECT_GE(moved.report->duration, kAll);
  EXPECT_LT(moved.report->duration, kAll + seconds(1));
  EXPECT_EQ(moved.report->timer_late_max_us, 0) << "no moment was passed over";
  EXPECT_TRUE(moved.report->doubts.empty());

  // In real time, which is sped up: its hour is a tenth of a second.
  Loop loop;
  HourOfQuestions hour(loop, 36'000, {.strictness = 2, .jitter = Micros(minutes(1)), .timing = GetParam()});
  const HourOfQuestions::Outcome real =
      hour.play([&](const std::function<bool()>& done) { run_until(loop, done); });
  ASSERT_TRUE(real.report && real.status);
  EXPECT_EQ(real.answers, moved.answers);
  EXPECT_EQ(real.report->verdict, moved.report->verdict);
  EXPECT_EQ(real.report->from_driver_matched, moved.report->from_driver_matched);
  EXPECT_EQ(real.report->to_driver_bytes, moved.report->to_driver_bytes);
  EXPECT_EQ(real.status, moved.status);
}

TEST_P(AnHourOfReplay, FindsTheQuestionThatCameLateAndByHowMuch) {
  const HourOfQuestions::Outcome moved = by_moved_clock(GetParam(), 30, milliseconds(250));
  ASSERT_TRUE(moved.report && moved.report->mismatch);
  EXPECT_EQ(moved.report->verdict, Verdict::timing_mismatch);
  EXPECT_EQ(moved.report->mismatch->error, milliseconds(250));
  EXPECT_EQ(moved.status, exit_status::kTimingMismatch);
}

// As a tty waits 30 s at its close (closing_wait), so does a session for the last bytes of a driver that has
// closed.
class LastBytes : public testing::Test {
 protected:
  LastBytes() {
    driver_.passive = true;
    driver_.up_at_once = false;
    session_ =
        std::make_unique<Session>(PortContext{&loop_, book_.log()}, std::make_unique<MemoryPort>(driver_),
                                  std::make_unique<MemoryPort>(device_), [](int) {});
    EXPECT_TRUE(session_->start().has_value());
    driver_.up();
    device_.congested = true;
    driver_.send("last");
    driver_.down(LineDown::Reason::closed);
  }
  [[nodiscard]] bool closed() const { return device_.calls.find("close ") != std::string::npos; }

  ManualClock clock_;
  Loop loop_{clock_};
  LogBook book_;
  MemoryPort::Peer driver_;
  MemoryPort::Peer device_;
  std::unique_ptr<Session> session_;
};

TEST_F(LastBytes, HaveThirtySeconds) {
  (void)let_pass(loop_, clock_, seconds(30) - milliseconds(1));
  EXPECT_FALSE(closed());
  (void)let_pass(loop_, clock_, milliseconds(2));
  EXPECT_TRUE(closed());
}

TEST_F(LastBytes, EndTheWaitWhenTheyHaveGone) {
  (void)let_pass(loop_, clock_, seconds(29));
  device_.drain();
  (void)let_pass(loop_, clock_, milliseconds(1));
  EXPECT_TRUE(closed());
}

TEST_F(LastBytes, HaveASecondWhereANextDriverWaitsAndNothingGoes) {
  device_.unread = 4;
  driver_.up();
  (void)let_pass(loop_, clock_, milliseconds(999));
  EXPECT_FALSE(closed());
  (void)let_pass(loop_, clock_, milliseconds(2));
  EXPECT_TRUE(closed());
}

TEST_F(LastBytes, HaveAsLongAsTheDeviceTakesThem) {
  device_.unread = 1000;
  for (int second = 0; second < 300; second += 10) {
    --*device_.unread;
    (void)let_pass(loop_, clock_, seconds(10));
    ASSERT_FALSE(closed());
  }
  (void)let_pass(loop_, clock_, seconds(31));
  EXPECT_TRUE(closed());
}

TEST_F(LastBytes, HaveThirtySecondsWhereANextDriverWaitsWhileTheyGo) {
  device_.unread = 100;
  driver_.up();
  for (int second = 1; second < 30; ++second) {
    --*device_.unread;
    (void)let_pass(loop_, clock_, seconds(1));
  }
  EXPECT_FALSE(closed());
  (void)let_pass(loop_, clock_, seconds(1));
  EXPECT_TRUE(closed());
}

TEST_F(LastBytes, HaveThirtySecondsWhereANextDriverWaitsAndNobodyKnowsWhetherTheyGo) {
  device_.unread.reset();
  driver_.up();
  (void)let_pass(loop_, clock_, seconds(30) - milliseconds(1));
  EXPECT_FALSE(closed());
  (void)let_pass(loop_, clock_, milliseconds(2));
  EXPECT_TRUE(closed());
}

}  // namespace
}  // namespace porttape
