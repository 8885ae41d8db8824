// Programs with rights of their own, looked for by one who has none.

#include "libport/supervise/lost_rights.hpp"

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <grp.h>
#include <linux/capability.h>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

constexpr unsigned kNobody = 65534;

class LostRightsTest : public testing::Test {
 protected:
  void SetUp() override {
    if (::geteuid() != 0) GTEST_SKIP() << "needs root, to make a file of another user's";
    ASSERT_EQ(::chmod(dir.path().c_str(), 0755), 0);
  }
  std::string program(const char* name, mode_t mode, const char* text = "\177ELF") const {
    const std::string path = dir / name;
    std::ofstream(path) << text;
    EXPECT_EQ(::chmod(path.c_str(), mode), 0);
    return path;
  }
  static std::string told_to(uid_t user, gid_t group, const std::function<std::string()>& say) {
    std::array<int, 2> ends{};
    EXPECT_EQ(::pipe(ends.data()), 0);
    const UniqueFd from(ends[0]);
    UniqueFd to(ends[1]);
    const pid_t child = ::fork();
    if (child == 0) {
      const bool is = ::setgroups(0, nullptr) == 0 && ::setgid(group) == 0 && ::setuid(user) == 0;
      const std::string text = is ? say() : "setuid failed";
      (void)!::write(to.get(), text.data(), text.size());
      ::_exit(0);
    }
    to.reset();
    std::array<char, 1024> text{};
    const ssize_t size = ::read(from.get(), text.data(), text.size());
    ::waitpid(child, nullptr, 0);
    return {text.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0))};
  }
  static std::string told(const std::string& command, uid_t user = kNobody, gid_t group = kNobody) {
    return told_to(user, group, [&] { return lost_rights(command); });
  }

  test::TempDir dir;
};

using testing::HasSubstr;

TEST_F(LostRightsTest, OfASetuidProgramAreItsOwners) {
  const std::string path = program("own", 04755);
  EXPECT_EQ(told(path), "'" + path +
                            "' is setuid 'root', and under a supervisor runs without those rights: run "
                            "porttape as 'root'");
  ASSERT_EQ(::chown(path.c_str(), 12345, 0), 0);
  ASSERT_EQ(::chmod(path.c_str(), 04755), 0);
  EXPECT_THAT(told(path), HasSubstr("setuid '12345'"));
  EXPECT_EQ(told(path, 12345), "") << "its own user";
  EXPECT_EQ(lost_rights(path), "") << "root";
}

TEST_F(LostRightsTest, OfASetgidProgramAreItsGroups) {
  const std::string path = program("group", 02755);
  ASSERT_EQ(::chown(path.c_str(), 0, 12345), 0);
  ASSERT_EQ(::chmod(path.c_str(), 02755), 0);
  EXPECT_THAT(told(path), HasSubstr("setgid '12345'"));
  EXPECT_EQ(told(path, kNobody, 12345), "") << "one of the group";
}

TEST_F(LostRightsTest, OfFileCapabilitiesAreRoots) {
  const std::string path = program("capable", 0755);
  vfs_cap_data capabilities{};
  capabilities.magic_etc = VFS_CAP_REVISION_2 | VFS_CAP_FLAGS_EFFECTIVE;
  capabilities.data[0].permitted = 1U << CAP_NET_RAW;
  if (::setxattr(path.c_str(), "security.capability", &capabilities, sizeof(capabilities), 0) != 0)
    GTEST_SKIP() << "no capabilities on this file system";
  EXPECT_THAT(told(path), HasSubstr("file capabilities"));
  EXPECT_THAT(told(path), HasSubstr("as root"));
}

TEST_F(LostRightsTest, TheProgramIsFoundOnThePath) {
  (void)program("there", 04755);
  const auto look = [this] {
    ::setenv("PATH", ("/nowhere:" + dir.path().string() + ":/bin").c_str(), 1);
    return lost_rights("there");
  };
  EXPECT_THAT(told_to(kNobody, kNobody, look), HasSubstr("/there' is setuid"));
}

TEST_F(LostRightsTest, OrdinaryProgramsAndScriptsHaveNone) {
  EXPECT_EQ(told(program("plain", 0755)), "");
  EXPECT_EQ(told(program("script", 04755, "#!/bin/sh\n")), "");
  EXPECT_EQ(told(dir / "none"), "");
  EXPECT_EQ(told("no-such-program-anywhere"), "");
}

}  // namespace
}  // namespace porttape
