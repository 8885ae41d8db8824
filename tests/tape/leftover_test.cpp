#include "libport/tape/leftover.hpp"

#include <array>
#include <fcntl.h>
#include <filesystem>
#include <signal.h>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class LeftoverTest : public testing::Test {
 protected:
  LeftoverTest() {
    fs::create_directory(folder);
    test::write_file(folder + "/inside", test::bytes_of("x"));
    test::write_file(file, test::bytes_of("x"));
  }

  test::TempDir dir;
  const std::string folder = dir / "folder";
  const std::string file = dir / "file";
};

TEST_F(LeftoverTest, GoesWithItsObjectUnlessItIsKept) {
  {
    Leftover one(folder);
    Leftover other = std::move(one);
    Leftover kept(file);
    kept.keep();
  }
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_TRUE(fs::exists(file));
}

TEST_F(LeftoverTest, GoesWithTheProcessThatASignalEnds) {
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    fs::create_directory(folder);
    test::write_file(folder + "/inside", test::bytes_of("x"));
    const pid_t child = ::fork();
    if (child == 0) {
      for (const int each : {SIGINT, SIGTERM, SIGHUP}) ::signal(each, SIG_DFL);
      const Leftover one(folder);
      Leftover kept(file);
      kept.keep();
      (void)::raise(number);
      ::_exit(0);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == number) << status;
    EXPECT_FALSE(fs::exists(folder));
    EXPECT_TRUE(fs::exists(file));
  }
}

TEST_F(LeftoverTest, ASecondSignalDoesNotEndTheWorkOfTheFirst) {
  for (int round = 0; round < 20; ++round) {
    fs::create_directory(folder);
    for (int i = 0; i < 200; ++i) test::write_file(folder + "/" + std::to_string(i), {});
    std::array<int, 2> ready{};
    ASSERT_EQ(::pipe(ready.data()), 0);
    const pid_t child = ::fork();
    if (child == 0) {
      for (const int each : {SIGINT, SIGTERM, SIGHUP}) ::signal(each, SIG_DFL);
      const Leftover one(folder);
      (void)!::write(ready[1], "x", 1);
      for (;;) ::pause();
    }
    char got = 0;
    EXPECT_EQ(::read(ready[0], &got, 1), 1);
    for (const int number : {SIGTERM, SIGTERM, SIGINT}) ::kill(child, number);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFSIGNALED(status)) << status;
    EXPECT_FALSE(fs::exists(folder));
    for (const int end : ready) ::close(end);
  }
}

TEST_F(LeftoverTest, ASignalThatIsIgnoredStaysSo) {
  const pid_t child = ::fork();
  if (child == 0) {
    (void)::signal(SIGHUP, SIG_IGN);
    const Leftover one(folder);
    (void)::raise(SIGHUP);
    ::_exit(fs::exists(folder) ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}

TEST_F(LeftoverTest, AFolderGoesAlsoWhereStandardInputIsClosed) {
  const pid_t child = ::fork();
  if (child == 0) {
    (void)::close(STDIN_FILENO);
    { const Leftover one(folder); }
    const bool is_free = ::open("/dev/null", O_RDONLY | O_CLOEXEC) == STDIN_FILENO;
    ::_exit(is_free ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  EXPECT_FALSE(fs::exists(folder));
}

TEST_F(LeftoverTest, WhatAnotherTakesTheNameOfGoesAtOnce) {
  Leftover one(folder);
  one = Leftover(file);
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_TRUE(fs::exists(file));
  EXPECT_EQ(one.path(), file);
  Leftover other = std::move(one);
  EXPECT_EQ(other.path(), file);
  other.remove();
  EXPECT_FALSE(fs::exists(file));
  EXPECT_EQ(other.path(), "");
  other.remove();
}

TEST_F(LeftoverTest, OnlySixteenAtATimeGoByASignalAndEachGivesItsPlaceBack) {
  const auto name = [&](std::size_t n) { return dir / ("x" + std::to_string(n)); };
  const pid_t child = ::fork();
  if (child == 0) {
    for (const int each : {SIGINT, SIGTERM, SIGHUP}) ::signal(each, SIG_DFL);
    for (int n = 0; n < 100; ++n) {
      const Leftover first(dir / "none");
      Leftover moved(dir / "none");
      Leftover last = std::move(moved);
      last.keep();
    }
    std::array<Leftover, Leftover::kMost + 1> all;
    for (std::size_t n = 0; n < all.size(); ++n) {
      test::write_file(name(n), {});
      all.at(n) = Leftover(name(n));
    }
    (void)::raise(SIGTERM);
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFSIGNALED(status)) << status;
  for (std::size_t n = 0; n < Leftover::kMost; ++n) EXPECT_FALSE(fs::exists(name(n))) << n;
  EXPECT_TRUE(fs::exists(name(Leftover::kMost)));
}

TEST_F(LeftoverTest, AFolderWithinStaysAndWhatIsThereGoes) {
  fs::create_directory(folder + "/inner");
  { const Leftover one(folder); }
  EXPECT_TRUE(fs::exists(folder + "/inner"));
  EXPECT_FALSE(fs::exists(folder + "/inside"));
}

TEST_F(LeftoverTest, AChildLeavesAloneWhatItsParentHas) {
  const Leftover one(folder);
  const pid_t child = ::fork();
  if (child == 0) {
    (void)::raise(SIGTERM);
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM) << status;
  EXPECT_TRUE(fs::exists(folder));
}

}  // namespace
}  // namespace porttape
