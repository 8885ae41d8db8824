// Whose a new pty is, and what is said where none can be made.

#include <cerrno>
#include <cstdint>
#include <fcntl.h>
#include <string>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/loop/file_events.hpp"
#include "libport/loop/loop.hpp"
#include "libport/tty/pty.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

class PtyAccessTest : public testing::Test {
 protected:
  // What creating one says where these calls fail.
  static void expect_error(const std::vector<test::RefusedCall>& calls, const std::string& pattern) {
    EXPECT_TRUE(test::holds_without(calls, [&pattern] {
      Loop own_loop;
      FileEvents own_events(own_loop);
      const Result<Pty> pty = Pty::create(own_events, {});
      ASSERT_FALSE(pty.has_value()) << pattern;
      EXPECT_EQ(pty.error().code, Errc::io);
      EXPECT_THAT(pty.error().message, testing::MatchesRegex(pattern));
    }));
  }

  Loop loop;
  FileEvents events{loop};
};

TEST_F(PtyAccessTest, ItIsTheUsersThatAreAskedForByNumber) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to give it away";
  const Result<Pty> pty = Pty::create(events, {.mode = 0620, .owner = "12345", .group = "23456"});
  ASSERT_TRUE(pty.has_value()) << pty.error().message;
  struct stat status {};
  ASSERT_EQ(::stat(pty->slave_path().c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, 12345U);
  EXPECT_EQ(status.st_gid, 23456U);
  EXPECT_EQ(status.st_mode & 07777U, 0620U);
}

TEST_F(PtyAccessTest, ItIsTheUsersThatAreAskedForByName) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to give it away";
  const Result<Pty> pty = Pty::create(events, {.owner = "daemon", .group = "daemon"});
  ASSERT_TRUE(pty.has_value()) << pty.error().message;
  struct stat status {};
  ASSERT_EQ(::stat(pty->slave_path().c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, 1U);
  EXPECT_EQ(status.st_gid, 1U);
}

TEST_F(PtyAccessTest, OneOfBothLeavesTheOther) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to give it away";
  const Result<Pty> plain = Pty::create(events, {});
  const Result<Pty> pty = Pty::create(events, {.owner = "12345"});
  const Result<Pty> other = Pty::create(events, {.group = "23456"});
  ASSERT_TRUE(plain && pty && other);
  struct stat before {};
  struct stat status {};
  ASSERT_EQ(::stat(plain->slave_path().c_str(), &before), 0);
  ASSERT_EQ(::stat(pty->slave_path().c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, 12345U);
  EXPECT_EQ(status.st_gid, before.st_gid);
  ASSERT_EQ(::stat(other->slave_path().c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, before.st_uid);
  EXPECT_EQ(status.st_gid, 23456U);
}

TEST_F(PtyAccessTest, AnUnknownUserOrGroupIsNamedWithItsOption) {
  EXPECT_EQ(Pty::create(events, {.owner = "no-such"}).error().message,
            "option 'owner': there is no user 'no-such'");
  EXPECT_EQ(Pty::create(events, {.group = "no-such"}).error().message,
            "option 'group': there is no group 'no-such'");
}

TEST_F(PtyAccessTest, WhereNoneCanBeMadeTheStepIsNamed) {
  expect_error({{SYS_openat, EMFILE}}, "pty: no pty to be had: Too many open files");
  expect_error({test::refused_ioctl(TIOCSPTLCK, EIO)}, "pty: unlocking it: Input/output error");
  expect_error({test::refused_ioctl(TIOCGPTN, EIO)}, "pty: unlocking it: Input/output error");
  expect_error({test::refused_ioctl(TIOCPKT, EIO)}, "pty: packet mode: Input/output error");
#ifdef SYS_chown
  expect_error({{SYS_chown, EPERM}}, "pty: giving /dev/pts/[0-9]+ its owner: Operation not permitted");
#endif
#ifdef SYS_chmod
  expect_error({{SYS_chmod, EPERM}}, "pty: giving /dev/pts/[0-9]+ its mode: Operation not permitted");
#endif
}

}  // namespace
}  // namespace porttape
