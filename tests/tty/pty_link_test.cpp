#include "libport/tty/pty_link.hpp"

#include <array>
#include <cerrno>
#include <cstdint>
#include <ctime>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <optional>
#include <string>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/own_name.hpp"
#include "tests/support/refused_calls.hpp"
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

TEST_F(PtyLinkTest, EachErrorSaysWhatIsToBeDone) {
  const auto error = [this](const std::string& at) {
    const Result<PtyLink> link = PtyLink::publish(at, target);
    EXPECT_TRUE(!link && link.error().code == Errc::usage);
    return link ? std::string() : link.error().message;
  };
  const std::string folder = (dir.path() / "no").string();
  EXPECT_EQ(error(folder + "/port"),
            "link '" + folder + "/port': its folder does not exist; type mkdir -p " + folder);
  EXPECT_EQ(error(target),
            "link '" + target + "' exists and is not a link; it is left alone, choose another path");
  fs::create_symlink("/dev/null", path);
  EXPECT_EQ(error(path), "link '" + path +
                             "' exists and points to '/dev/null', which is in use; remove it or choose "
                             "another path");
}

TEST_F(PtyLinkTest, RetargetThatFailsNamesItAndLeavesNothingBehind) {
  Result<PtyLink> link = PtyLink::publish(path, target);
  ASSERT_TRUE(link.has_value());
  fs::remove(path);
  fs::create_directory(path);
  const Result<void> moved = link->retarget("/dev/null");
  ASSERT_FALSE(moved.has_value());
  EXPECT_EQ(moved.error().message,
            "link '" + path +
                "' cannot be made: something else is there by now; it is left alone, choose another path");
  EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 2)
      << "the folder and the target";
  EXPECT_EQ(link->path(), path);
}

TEST_F(PtyLinkTest, WhatSomebodyElsePutInItsPlaceIsNotReplacedEither) {
  const std::vector<std::function<void()>> others = {
      [this] { std::ofstream(path) << "precious"; },
      [this] { fs::create_symlink("/dev/zero", path); },
      [this] { fs::create_symlink(target, path); },  // of another program, to the same pty
      [this] { fs::create_directory(path); },
  };
  for (const auto& put : others) {
    {
      Result<PtyLink> link = PtyLink::publish(path, target);
      ASSERT_TRUE(link.has_value());
      fs::remove(path);
      put();
      const std::optional<FileIdentity> other = FileIdentity::at(AT_FDCWD, path);
      EXPECT_FALSE(link->retarget("/dev/null").has_value());
      EXPECT_EQ(FileIdentity::at(AT_FDCWD, path), other);
      fs::rename(path, path + ".moved");
      EXPECT_TRUE(link->retarget("/dev/null").has_value()) << "the place is free again";
      EXPECT_EQ(fs::read_symlink(path), "/dev/null");
      fs::remove(path);
      fs::rename(path + ".moved", path);
    }
    EXPECT_TRUE(fs::exists(fs::symlink_status(path)));
    fs::remove_all(path);
  }
}

TEST_F(PtyLinkTest, RetargetMakesAgainWhatSomebodyRemoved) {
  Result<PtyLink> link = PtyLink::publish(path, target);
  ASSERT_TRUE(link.has_value());
  fs::remove(path);
  ASSERT_TRUE(link->retarget("/dev/null").has_value());
  EXPECT_EQ(fs::read_symlink(path), "/dev/null");
}

TEST_F(PtyLinkTest, RetargetMakesItInTheFolderThatHasTheNameByNow) {
  const std::string folder = (dir.path() / "folder").string();
  fs::create_directory(folder);
  {
    Result<PtyLink> link = PtyLink::publish(folder + "/port", target);
    ASSERT_TRUE(link.has_value());
    fs::remove_all(folder);
    EXPECT_FALSE(link->retarget("/dev/null").has_value());
    fs::create_directory(folder);
    ASSERT_TRUE(link->retarget("/dev/null").has_value());
    EXPECT_EQ(fs::read_symlink(folder + "/port"), "/dev/null");
  }
  EXPECT_TRUE(fs::is_empty(folder));
}

TEST_F(PtyLinkTest, IsNotMadeBehindAnotherUsersLink) {
  const std::string folder = (dir.path() / "folder").string();
  const std::string way = (dir.path() / "way").string();
  fs::create_directory(folder);
  fs::create_symlink("folder", way);
  Result<PtyLink> link = PtyLink::publish(way + "/port", target);
  ASSERT_TRUE(link.has_value()) << link.error().message;
  EXPECT_EQ(fs::read_symlink(folder + "/port"), target);
  if (::lchown(way.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "only root can make a link of another user";
  const std::string why = "'way' on the way there is a link that another user made; name the folder itself";
  const Result<PtyLink> other = PtyLink::publish(way + "/other", target);
  ASSERT_FALSE(other.has_value());
  EXPECT_EQ(other.error().code, Errc::usage);
  EXPECT_EQ(other.error().message, "link '" + way + "/other': " + why);
  ASSERT_TRUE(link->retarget("/dev/null").has_value()) << "it is the folder that it has been made in";
  fs::create_directory(folder + ".other");
  fs::remove(way);
  fs::create_symlink("folder.other", way);
  ASSERT_EQ(::lchown(way.c_str(), 12345, 12345), 0);
  const Result<void> moved = link->retarget(target);
  ASSERT_FALSE(moved.has_value());
  EXPECT_EQ(moved.error().message, "link '" + way + "/port': " + why);
  EXPECT_TRUE(fs::is_empty(folder + ".other"));
  *link = *PtyLink::publish(path, target);
  EXPECT_TRUE(fs::is_empty(folder)) << "it is removed where it was made";
}

TEST_F(PtyLinkTest, AnotherThatTakesItsPlaceTakesItAway) {
  Result<PtyLink> first = PtyLink::publish(path, target);
  Result<PtyLink> second = PtyLink::publish(path + ".other", target);
  ASSERT_TRUE(first.has_value() && second.has_value());
  *first = std::move(*second);
  EXPECT_FALSE(fs::exists(fs::symlink_status(path)));
  EXPECT_EQ(fs::read_symlink(path + ".other"), target);
  EXPECT_EQ(first->path(), path + ".other");
}

TEST_F(PtyLinkTest, ItsOwnLinkToTheSamePtyIsTakenAgain) {
  fs::create_symlink(target, path);
  EXPECT_TRUE(PtyLink::publish(path, target).has_value());
}

TEST_F(PtyLinkTest, ACallThatFailsIsToldAndLeavesNothing) {
  const std::pair<test::RefusedCall, std::string> cases[] = {
      {{SYS_symlinkat, EROFS}, "Read-only file system"},
      {{SYS_symlinkat, EACCES}, "Permission denied"},
      {{SYS_symlinkat, ENOSPC}, "No space left on device"},
      {{SYS_renameat2, EIO}, "Input/output error"},
      {{SYS_renameat2, EEXIST}, "something else is there by now; it is left alone, choose another path"}};
  std::optional<PtyLink> old;
  for (const bool again : {false, true}) {
    if (again) {
      Result<PtyLink> made = PtyLink::publish(path, target);
      ASSERT_TRUE(made.has_value());
      old.emplace(std::move(*made));
    }
    for (const auto& [call, text] : cases) {
      EXPECT_TRUE(test::while_refused({call}, [&, why = text] {
        const Error error =
            again ? old->retarget("/dev/null").error() : PtyLink::publish(path, target).error();
        EXPECT_EQ(error, make_error(Errc::usage, "link '" + path + "' cannot be made: " + why));
      }));
      for (const auto& entry : fs::directory_iterator(dir.path()))
        EXPECT_TRUE(entry.path() == target || (again && entry.path() == path)) << entry.path();
      if (again) {
        EXPECT_EQ(fs::read_symlink(path), target) << "it leads where it did";
      }
    }
  }
  ASSERT_TRUE(old->retarget("/dev/null").has_value());
  EXPECT_EQ(fs::read_symlink(path), "/dev/null");
}

TEST_F(PtyLinkTest, OneThatCannotBeLookedAtAsItIsMadeIsTakenBack) {
  EXPECT_TRUE(test::while_refused({test::refused_open(O_PATH | O_NOFOLLOW, EMFILE)}, [&] {
    const Result<PtyLink> link = PtyLink::publish(path, target);
    ASSERT_FALSE(link.has_value());
    EXPECT_EQ(link.error().code, Errc::usage);
    EXPECT_NE(link.error().message.find("Too many open files"), std::string::npos);
  }));
  for (const auto& entry : fs::directory_iterator(dir.path())) EXPECT_EQ(entry.path(), target);
}

TEST_F(PtyLinkTest, OneThatCannotBeMarkedIsMadeAllTheSame) {
  EXPECT_TRUE(test::while_refused({{SYS_utimensat, EPERM}}, [&] {
    const Result<PtyLink> link = PtyLink::publish(path, target);
    ASSERT_TRUE(link.has_value());
    EXPECT_EQ(fs::read_symlink(path), target);
  }));
  EXPECT_FALSE(fs::exists(fs::symlink_status(path)));
}

}  // namespace
}  // namespace porttape
