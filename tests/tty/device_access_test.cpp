#include "libport/tty/device_access.hpp"

#include <grp.h>
#include <sys/stat.h>
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

}  // namespace
}  // namespace porttape
