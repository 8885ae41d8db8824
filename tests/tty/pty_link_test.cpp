#include "libport/tty/pty_link.hpp"

#include <array>
#include <cstdint>
#include <ctime>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sys/stat.h>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class PtyLinkTest : public testing::Test {
 protected:
  PtyLinkTest() : path((dir.path() / "port").string()), target((dir.path() / "target").string()) {
    std::ofstream(target) << "";
  }

  test::TempDir dir;
  std::string path;
  std::string target;
};

TEST_F(PtyLinkTest, IsThereUntilItsOwnerGoes) {
  {
    const Result<PtyLink> link = PtyLink::publish(path, target);
    ASSERT_TRUE(link.has_value());
    EXPECT_EQ(fs::read_symlink(path), target);
  }
  EXPECT_FALSE(fs::exists(fs::symlink_status(path)));
}

TEST_F(PtyLinkTest, NeverReplacesAFile) {
  std::ofstream(path) << "precious";
  const Result<PtyLink> link = PtyLink::publish(path, target);
  ASSERT_FALSE(link.has_value());
  EXPECT_EQ(link.error().code, Errc::usage);
  EXPECT_EQ(fs::file_size(path), 8U);
}

TEST_F(PtyLinkTest, NeverReplacesAForeignLinkThatIsInUse) {
  fs::create_symlink("/dev/null", path);
  ASSERT_FALSE(PtyLink::publish(path, target).has_value());
  EXPECT_EQ(fs::read_symlink(path), "/dev/null");
}

TEST_F(PtyLinkTest, ReplacesADanglingLink) {
  fs::create_symlink(dir.path() / "gone", path);
  const Result<PtyLink> link = PtyLink::publish(path, target);
  ASSERT_TRUE(link.has_value());
  EXPECT_EQ(fs::read_symlink(path), target);
}

TEST_F(PtyLinkTest, ReplacesItsOwnLinkWhosePtyNumberIsAnotherProgramsNow) {
  {
    const Result<PtyLink> ours = PtyLink::publish(path, target);
    ASSERT_TRUE(ours.has_value());
    fs::copy_symlink(path, path + ".left");
    struct stat made {};
    ASSERT_EQ(::lstat(path.c_str(), &made), 0);
    std::array<timespec, 2> long_ago = {made.st_mtim, made.st_mtim};
    long_ago[1].tv_sec -= 100;  // before `target` was made
    ASSERT_EQ(::utimensat(AT_FDCWD, (path + ".left").c_str(), long_ago.data(), AT_SYMLINK_NOFOLLOW), 0);
  }
  const Result<PtyLink> link = PtyLink::publish(path + ".left", "/dev/null");
  ASSERT_TRUE(link.has_value()) << link.error().message;
  EXPECT_EQ(fs::read_symlink(path + ".left"), "/dev/null");
}

// A later one would have the next pty of that number look older than the link of a program that was killed at
// once.
TEST_F(PtyLinkTest, IsMarkedWithTheTimeOfItsPty) {
  const Result<PtyLink> link = PtyLink::publish(path, target);
  ASSERT_TRUE(link.has_value());
  struct stat mark {};
  struct stat pty {};
  ASSERT_EQ(::lstat(path.c_str(), &mark), 0);
  ASSERT_EQ(::stat(path.c_str(), &pty), 0);
  const auto ns = [](const timespec& time) {
    return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
  };
  EXPECT_GE(ns(mark.st_mtim), ns(pty.st_ctim));
  EXPECT_LT(ns(mark.st_mtim), ns(pty.st_ctim) + 1'000'000);
}

TEST_F(PtyLinkTest, RetargetMarksItWithTheTimeOfTheOtherPty) {
  Result<PtyLink> link = PtyLink::publish(path, target);
  ASSERT_TRUE(link.has_value());
  std::ofstream(target + ".later") << "";
  ASSERT_TRUE(link->retarget(target + ".later").has_value());
  EXPECT_FALSE(PtyLink::publish(path, "/dev/null").has_value());
}

TEST_F(PtyLinkTest, NeverReplacesALinkOfALivingPorttape) {
  const Result<PtyLink> first = PtyLink::publish(path, target);
  ASSERT_TRUE(first.has_value());
  EXPECT_FALSE(PtyLink::publish(path, "/dev/null").has_value());
}

TEST_F(PtyLinkTest, AMissingFolderIsNamed) {
  const Result<PtyLink> link = PtyLink::publish((dir.path() / "no" / "port").string(), target);
  ASSERT_FALSE(link.has_value());
  EXPECT_NE(link.error().message.find((dir.path() / "no").string()), std::string::npos);
}

TEST_F(PtyLinkTest, LeavesAloneWhatSomebodyElsePutInItsPlace) {
  {
    const Result<PtyLink> link = PtyLink::publish(path, target);
    ASSERT_TRUE(link.has_value());
    fs::remove(path);
    fs::create_symlink("/dev/null", path);
  }
  EXPECT_EQ(fs::read_symlink(path), "/dev/null");
}

TEST_F(PtyLinkTest, RetargetMovesItAndStillOwnsIt) {
  {
    Result<PtyLink> link = PtyLink::publish(path, target);
    ASSERT_TRUE(link.has_value());
    ASSERT_TRUE(link->retarget("/dev/null").has_value());
    EXPECT_EQ(fs::read_symlink(path), "/dev/null");
  }
  EXPECT_FALSE(fs::exists(fs::symlink_status(path)));
}

}  // namespace
}  // namespace porttape
