#include "tools/job_pool.hpp"

#include <atomic>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <signal.h>
#include <stdexcept>
#include <string>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/next_call.hpp"
#include "tests/support/temp_dir.hpp"

namespace {

std::atomic<int> forks_allowed = -1;  // then EAGAIN; below zero: all

}  // namespace

extern "C" pid_t fork() noexcept {
  if (forks_allowed == 0) {
    errno = EAGAIN;
    return -1;
  }
  if (forks_allowed > 0) --forks_allowed;
  return porttape::next_call<pid_t (*)()>("fork")();
}

namespace porttape::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;
using testing::StartsWith;

std::unique_ptr<JobPool> make_pool(std::size_t workers, JobWork work, std::optional<Nanos> limit = {}) {
  auto pool = JobPool::make({.workers = workers, .work = std::move(work), .limit = limit});
  EXPECT_TRUE(pool) << pool.error().message;
  return std::move(*pool);
}

std::map<std::size_t, JobDone> all_of(JobPool& pool) {
  std::map<std::size_t, JobDone> all;
  while (auto done = pool.wait()) all.emplace(done->job, *done);
  return all;
}

std::string pid_text() { return std::to_string(::getpid()); }

[[noreturn]] void sleep_for_ever() {
  for (;;) ::pause();
}

// Tells a test that a job has come so far.
class Bell {
 public:
  Bell() { EXPECT_EQ(::pipe(ends_), 0); }
  ~Bell() {
    ::close(ends_[0]);
    ::close(ends_[1]);
  }
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;
  void ring() const { (void)!::write(ends_[1], "x", 1); }
  void wait() const {
    char byte = 0;
    (void)!::read(ends_[0], &byte, 1);
  }

 private:
  int ends_[2] = {-1, -1};
};

TEST(JobPool, GivesEachJobsResult) {
  const auto pool = make_pool(3, [](const std::string& job) { return job + job; });
  for (int i = 0; i < 50; ++i) EXPECT_EQ(pool->add(std::to_string(i)), static_cast<std::size_t>(i));
  const auto all = all_of(*pool);
  ASSERT_EQ(all.size(), 50U);
  for (const auto& [number, done] : all) {
    EXPECT_EQ(done.result, std::to_string(number) + std::to_string(number));
    EXPECT_EQ(done.trouble, "");
  }
}

TEST(JobPool, AWorkerDoesJobAfterJob) {
  const auto pool = make_pool(2, [](const std::string&) { return pid_text(); });
  for (int i = 0; i < 20; ++i) pool->add("");
  std::set<std::string> pids;
  for (const auto& [number, done] : all_of(*pool)) pids.insert(done.result);
  EXPECT_LE(pids.size(), 2U);
  pool->add("");
  EXPECT_TRUE(pids.contains(pool->wait()->result));
}

TEST(JobPool, LongJobsAndResultsArriveWhole) {
  const auto pool = make_pool(2, [](const std::string& job) { return job + "!"; });
  const std::string text(3'000'000, 'x');
  pool->add(text);
  pool->add(text);
  for (const auto& [number, done] : all_of(*pool)) EXPECT_EQ(done.result, text + "!");
}

TEST(JobPool, AWorkerThatDiesIsToldAndReplaced) {
  const auto pool = make_pool(1, [](const std::string& job) {
    if (job == "die") ::raise(SIGKILL);
    if (job == "leave") ::_exit(3);
    return job;
  });
  for (const char* job : {"one", "die", "two", "leave", "three"}) pool->add(job);
  const auto all = all_of(*pool);
  ASSERT_EQ(all.size(), 5U);
  EXPECT_EQ(all.at(1).trouble, "its process was ended by SIGKILL (9)");
  EXPECT_EQ(all.at(3).trouble, "its process ended with status 3");
  EXPECT_EQ(all.at(4).result, "three");
}

TEST(JobPool, WhatADeadWorkerStartedIsEnded) {
  const TempDir dir;
  const std::string file = dir / "pid";
  const auto pool = make_pool(2, [&](const std::string&) -> std::string {
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::setsid();
      sleep_for_ever();
    }
    std::ofstream(file) << pid << std::flush;
    ::raise(SIGKILL);
    return {};
  });
  pool->add("");
  EXPECT_NE(pool->wait()->trouble, "");
  pid_t pid = 0;
  std::ifstream(file) >> pid;
  ASSERT_GT(pid, 0);
  EXPECT_NE(::kill(pid, 0), 0);
}

TEST(JobPool, WhatAJobThrowsIsItsTrouble) {
  const auto pool =
      make_pool(1, [](const std::string&) -> std::string { throw std::runtime_error("no such tape"); });
  pool->add("");
  EXPECT_EQ(pool->wait()->trouble, "no such tape");
}

TEST(JobPool, AJobThatHangsIsEnded) {
  const auto pool = make_pool(
      1,
      [](const std::string& job) -> std::string {
        if (job == "hang") sleep_for_ever();
        return job;
      },
      milliseconds(50));
  pool->add("hang");
  EXPECT_EQ(pool->wait()->trouble, "took longer than 0.05 s, and was ended");
  pool->add("next");
  EXPECT_EQ(pool->wait()->result, "next");
}

TEST(JobPool, KeepsWhatAJobWrote) {
  const auto pool = make_pool(1, [](const std::string& job) -> std::string {
    if (job != "flood") (void)!::write(STDOUT_FILENO, job.data(), job.size());
    if (job != "flood") (void)!::write(STDERR_FILENO, "!", 1);
    const std::string line(1000, 'x');
    for (int i = 0; job == "flood" && i < 1000; ++i) (void)!::write(STDOUT_FILENO, line.data(), line.size());
    return {};
  });
  for (const char* job : {"one", "flood", "two"}) pool->add(job);
  const auto all = all_of(*pool);
  EXPECT_EQ(all.at(0).output, "one!");
  EXPECT_EQ(all.at(2).output, "two!");
  EXPECT_LT(all.at(1).output.size(), 200'000U);
  EXPECT_THAT(all.at(1).output, HasSubstr("bytes are left out here"));
}

TEST(JobPool, TheUsersSignalEndsWhatRunsAndBeginsNothing) {
  const Bell bell;
  const auto pool = make_pool(2, [&](const std::string&) -> std::string {
    bell.ring();
    sleep_for_ever();
  });
  for (int i = 0; i < 5; ++i) pool->add("");
  EXPECT_FALSE(pool->wait(Instant::clock::now()));
  bell.wait();
  bell.wait();
  ::kill(::getpid(), SIGINT);
  const auto all = all_of(*pool);
  EXPECT_EQ(pool->interrupted_by(), SIGINT);
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all.at(0).trouble, "interrupted by SIGINT (2)");
}

TEST(JobPool, ASecondSignalKillsWhatHandlesTheFirst) {
  const Bell bell;
  const auto pool = make_pool(1, [&](const std::string&) -> std::string {
    ::signal(SIGTERM, SIG_IGN);
    bell.ring();
    sleep_for_ever();
  });
  pool->add("");
  EXPECT_FALSE(pool->wait(Instant::clock::now()));
  bell.wait();
  ::kill(::getpid(), SIGTERM);
  EXPECT_FALSE(pool->wait(Instant::clock::now() + milliseconds(50)));
  ::kill(::getpid(), SIGTERM);
  EXPECT_EQ(pool->wait()->trouble, "interrupted by SIGTERM (15)");
}

// A handler that a job leaves behind would make the next one deaf.
TEST(JobPool, AJobsSignalHandlersEndWithIt) {
  const Bell bell;
  const auto pool = make_pool(1, [&](const std::string& job) -> std::string {
    if (job == "handle") {
      ::signal(SIGTERM, SIG_IGN);
      return job;
    }
    bell.ring();
    sleep_for_ever();
  });
  pool->add("handle");
  EXPECT_EQ(pool->wait()->result, "handle");
  pool->add("hang");
  EXPECT_FALSE(pool->wait(Instant::clock::now()));
  bell.wait();
  ::kill(::getpid(), SIGTERM);
  EXPECT_EQ(pool->wait()->trouble, "interrupted by SIGTERM (15)");
}

TEST(JobPool, CancelledJobsAreNotTold) {
  const auto pool = make_pool(1, [](const std::string& job) -> std::string {
    if (job == "hang") sleep_for_ever();
    return job;
  });
  pool->add("hang");
  pool->add("never begun");
  EXPECT_FALSE(pool->wait(Instant::clock::now()));
  pool->cancel();
  EXPECT_FALSE(pool->wait());
  pool->add("next");
  EXPECT_EQ(pool->wait()->result, "next");
}

TEST(JobPool, AsManyWorkersAsThereAreProcessesToBeHad) {
  const auto pool = make_pool(4, [](const std::string& job) { return job + pid_text(); });
  for (int i = 0; i < 20; ++i) pool->add("");
  forks_allowed = 1;
  const auto all = all_of(*pool);
  forks_allowed = -1;
  ASSERT_EQ(all.size(), 20U);
  for (const auto& [number, done] : all) EXPECT_EQ(done.result, all.at(0).result);
}

TEST(JobPool, WithoutAnyProcessEachJobSaysSo) {
  const auto pool = make_pool(4, [](const std::string& job) { return job; });
  pool->add("");
  pool->add("");
  forks_allowed = 0;
  const auto all = all_of(*pool);
  forks_allowed = -1;
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all.at(1).trouble, "no process can be started: Resource temporarily unavailable");
}

TEST(JobPool, EndsWithItsWorkers) {
  std::string pid;
  {
    const auto pool = make_pool(1, [](const std::string&) { return pid_text(); });
    pool->add("");
    pid = pool->wait()->result;
    EXPECT_EQ(::kill(std::stoi(pid), 0), 0);
  }
  EXPECT_NE(::kill(std::stoi(pid), 0), 0);
}

}  // namespace
}  // namespace porttape::test
