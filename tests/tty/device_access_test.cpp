#include "libport/tty/device_access.hpp"

#include <grp.h>
#include <pwd.h>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

DeviceAccess dialout() {
  return {.device = "/dev/ttyUSB0", .user = "ann", .owner = "root", .group = "dialout", .group_may = true};
}

TEST(DeviceAccess, TheGroupThatMayOpenItIsToBeJoined) {
  EXPECT_EQ(access_advice(dialout()),
            "it belongs to group 'dialout'; add yourself: sudo usermod -aG dialout ann, then log in again");
  DeviceAccess access = dialout();
  access.is_listed = true;
  EXPECT_EQ(access_advice(access),
            "it belongs to group 'dialout', to which you have been added: log in again");
  access.is_member = true;
  EXPECT_EQ(access_advice(access),
            "it belongs to group 'dialout', which may open it, and so are you; see getfacl /dev/ttyUSB0");
}

TEST(DeviceAccess, RootsGroupAndOneThatMayNotAreNotJoined) {
  const std::string chown =
      "only 'root' may open it; make it yours until it is plugged in again: sudo chown ann /dev/ttyUSB0";
  DeviceAccess access = dialout();
  access.group_may = false;
  EXPECT_EQ(access_advice(access), chown);
  access = dialout();
  access.group = "root";
  EXPECT_EQ(access_advice(access), chown);
  access.owner = "ann";
  EXPECT_EQ(access_advice(access), "it is yours and closed to you: chmod u+rw /dev/ttyUSB0");
}

TEST(DeviceAccess, IsWhatTheSystemSays) {
  const test::TempDir dir;
  const std::string file = dir / "device";
  test::write_file(file, {});
  ASSERT_EQ(::chmod(file.c_str(), 0640), 0);
  const DeviceAccess to_read = device_access(file, R_OK);
  EXPECT_EQ(to_read.owner, to_read.user);
  EXPECT_TRUE(to_read.group_may);
  EXPECT_TRUE(to_read.is_member);
  const group* const own = ::getgrgid(::getegid());
  EXPECT_EQ(to_read.group, own != nullptr ? own->gr_name : std::to_string(::getegid()));
  EXPECT_FALSE(device_access(file, R_OK | W_OK).group_may);
  EXPECT_EQ(access_advice(device_access(dir / "none", R_OK)), "see ls -l " + (dir / "none"));
}

TEST(DeviceAccess, WhatIsWantedIsEachOfReadingAndWriting) {
  struct Case {
    mode_t mode;
    int wanted;
    bool may;
  };
  const test::TempDir dir;
  const std::string file = dir / "device";
  test::write_file(file, {});
  for (const Case& each :
       {Case{0640, R_OK, true}, Case{0640, W_OK, false}, Case{0620, R_OK, false}, Case{0620, W_OK, true},
        Case{0660, R_OK | W_OK, true}, Case{0620, R_OK | W_OK, false}, Case{0606, R_OK, false}}) {
    ASSERT_EQ(::chmod(file.c_str(), each.mode), 0);
    EXPECT_EQ(device_access(file, each.wanted).group_may, each.may) << each.mode << " " << each.wanted;
  }
}

TEST(DeviceAccess, NamesAreThoseOfTheSystemsFiles) {
  struct stat status {};
  ASSERT_EQ(::stat("/etc/passwd", &status), 0);
  const passwd* const owner = ::getpwuid(status.st_uid);
  const group* const group = ::getgrgid(status.st_gid);
  if (owner == nullptr || group == nullptr) GTEST_SKIP() << "/etc/passwd belongs to nobody";
  const DeviceAccess access = device_access("/etc/passwd", R_OK);
  EXPECT_EQ(access.device, "/etc/passwd");
  EXPECT_EQ(access.owner, owner->pw_name);
  EXPECT_EQ(access.group, group->gr_name);
  const passwd* const own = ::getpwuid(::geteuid());
  EXPECT_EQ(access.user, own != nullptr ? own->pw_name : std::to_string(::geteuid()));
}

TEST(DeviceAccess, WhoHasNoNameIsANumber) {
  const test::TempDir dir;
  const std::string file = dir / "device";
  test::write_file(file, {});
  if (::chown(file.c_str(), 4'000'000'001U, 4'000'000'002U) != 0)
    GTEST_SKIP() << "needs root, to give a file away";
  const DeviceAccess access = device_access(file, R_OK);
  EXPECT_EQ(access.owner, "4000000001");
  EXPECT_EQ(access.group, "4000000002");
  EXPECT_FALSE(access.is_member);
  EXPECT_FALSE(access.is_listed);
}

TEST(DeviceAccess, AProcessIsOfItsFurtherGroupsToo) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs root, to be of other groups";
  const test::TempDir dir;
  const std::string file = dir / "device";
  test::write_file(file, {});
  const auto is_member = [&file](gid_t group) {
    return ::chown(file.c_str(), 0, group) == 0 && device_access(file, R_OK).is_member;
  };
  const pid_t child = ::fork();
  if (child == 0) {
    const gid_t further[] = {4'000'000'001U, 4'000'000'002U};
    if (::setgroups(2, further) != 0 || ::chown(file.c_str(), 0, 4'000'000'003U) != 0) ::_exit(2);
    ::_exit(is_member(further[0]) && is_member(further[1]) && is_member(::getegid()) &&
                    !is_member(4'000'000'003U)
                ? 0
                : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 2) GTEST_SKIP() << "groups cannot be set here";
  EXPECT_EQ(status, 0);
}

}  // namespace
}  // namespace porttape
