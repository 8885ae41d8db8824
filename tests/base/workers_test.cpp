#include "libport/base/workers.hpp"

#include <chrono>
#include <future>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/clock.hpp"

namespace porttape {
namespace {

TEST(Workers, JobsOfAStrandRunInOrder) {
  Workers workers;
  const Workers::Strand strand;
  std::vector<int> order;
  std::promise<void> done;
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(workers.post(strand, [&order, i] { order.push_back(i); }));
  ASSERT_TRUE(workers.post(strand, [&done] { done.set_value(); }));
  done.get_future().wait();
  ASSERT_EQ(order.size(), 1000U);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], i);
}

TEST(Workers, JobsThatHangHoldUpTheirOwnStrandsAlone) {
  Workers workers;
  std::promise<void> release;
  const std::shared_future<void> released = release.get_future().share();
  std::vector<Workers::Strand> hanging(5);
  std::vector<std::promise<void>> ended(5);
  for (std::size_t i = 0; i < hanging.size(); ++i) {
    ASSERT_TRUE(workers.post(hanging[i], [released, &end = ended[i]] {
      released.wait();
      end.set_value();
    }));
  }
  std::promise<void> done;
  ASSERT_TRUE(workers.post(Workers::Strand(), [&done] { done.set_value(); }));
  done.get_future().wait();
  release.set_value();
  for (auto& end : ended) end.get_future().wait();
}

TEST(Workers, TimedJobsRunInTheirOrderAndNotBefore) {
  using Clock = std::chrono::steady_clock;
  Workers workers;
  const Workers::Strand strand;
  const Clock::time_point begin = Clock::now();
  const Clock::time_point first = begin + std::chrono::milliseconds(5);
  const Clock::time_point second = begin + std::chrono::milliseconds(10);
  std::vector<int> order;
  std::promise<Clock::time_point> done;
  ASSERT_TRUE(workers.post_at(second, strand, [&] {
    order.push_back(2);
    done.set_value(Clock::now());
  }));
  ASSERT_TRUE(workers.post_at(first, strand, [&] { order.push_back(1); }));
  EXPECT_GE(done.get_future().get(), second);
  EXPECT_EQ(order, (std::vector{1, 2}));
}

TEST(Workers, ATimedJobRunsWhileAnotherHangs) {
  Workers workers;
  std::promise<void> done, ended;
  ASSERT_TRUE(workers.post(Workers::Strand(), [&] {
    done.get_future().wait();
    ended.set_value();
  }));
  ASSERT_TRUE(workers.post_at(machine_clock().now() + std::chrono::milliseconds(1), Workers::Strand(),
                              [&] { done.set_value(); }));
  ended.get_future().wait();
}

TEST(Workers, AJobMayPost) {
  Workers workers;
  const Workers::Strand strand;
  std::promise<void> done;
  ASSERT_TRUE(
      workers.post(strand, [&] { EXPECT_TRUE(workers.post(strand, [&done] { done.set_value(); })); }));
  done.get_future().wait();
}

TEST(Workers, TheEndDoesNotWaitForAJobThatHangs) {
  struct Job {
    std::promise<void> begun, release, ended;
  };
  const auto job = std::make_shared<Job>();
  {
    Workers workers;
    ASSERT_TRUE(workers.post(Workers::Strand(), [job] {
      job->begun.set_value();
      job->release.get_future().wait();
      job->ended.set_value();
    }));
    job->begun.get_future().wait();
  }
  job->release.set_value();
  job->ended.get_future().wait();
}

}  // namespace
}  // namespace porttape
