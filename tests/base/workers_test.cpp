#include "libport/base/workers.hpp"

#include <condition_variable>
#include <future>
#include <mutex>
#include <vector>

#include <gtest/gtest.h>

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

TEST(Workers, AJobMayPost) {
  Workers workers;
  const Workers::Strand strand;
  std::promise<void> done;
  ASSERT_TRUE(workers.post(strand, [&] { EXPECT_TRUE(workers.post(strand, [&done] { done.set_value(); })); }));
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
