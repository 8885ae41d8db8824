#include "libport/tape/leftover.hpp"

#include <array>
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

}  // namespace
}  // namespace porttape
