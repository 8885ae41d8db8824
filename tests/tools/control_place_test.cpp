#include "tools/control_place.hpp"

#include <cstring>
#include <filesystem>
#include <sys/socket.h>
#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::TempDir;
using testing::ElementsAre;

std::vector<pid_t> pids(const ControlEnvironment& environment, const OtherUsers& others = {}) {
  std::vector<pid_t> found;
  for (const ControlSocket& each : control_sockets(environment, others)) found.push_back(each.pid);
  return found;
}

void make_socket(const std::string& path) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  const UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM, 0));
  const auto address = socket_address(path);
  ASSERT_TRUE(address);
  ASSERT_EQ(::bind(fd.get(), reinterpret_cast<const sockaddr*>(&*address), sizeof *address), 0);
}

TEST(ControlPlace, AFolderThatIsGivenComesFirstThenTheUsersOwn) {
  EXPECT_EQ(
      control_folder({.user = 7, .runtime_directory = "/run/porttape/x:/run/other", .xdg_runtime_dir = "/x"})
          .path,
      "/run/porttape/x");
  EXPECT_EQ(control_folder({.user = 0, .xdg_runtime_dir = "/x"}).path, "/run/porttape");
  EXPECT_EQ(control_folder({.user = 7, .xdg_runtime_dir = "/x"}).path, "/x/porttape");
  EXPECT_EQ(control_folder({.user = 7}).path, "/tmp/porttape-7");
  EXPECT_EQ(control_folder({.user = 7, .runtime_directory = "relative", .xdg_runtime_dir = "relative"}).path,
            "/tmp/porttape-7");
  EXPECT_EQ(control_socket("/run/porttape", 12), "/run/porttape/12.sock");
}

TEST(ControlPlace, TheUsersOwnAndTheUnitsAreFound) {
  const TempDir dir;
  ControlEnvironment environment{.user = ::geteuid(), .run = dir / "run", .tmp = dir / "tmp"};
  const std::string self = std::to_string(environment.user);
  make_socket(dir / "run/porttape/1.sock");
  make_socket(dir / "run/porttape/robot/2.sock");
  make_socket(dir / ("run/user/" + self + "/porttape/3.sock"));
  make_socket(dir / ("tmp/porttape-" + self + "/4.sock"));
  for (const char* other : {"x.sock", "5.sock.x", "-6.sock", "0.sock"})
    make_socket(dir / ("run/porttape/" + std::string(other)));
  test::write_file(dir / "run/porttape/7.sock", {});
  EXPECT_THAT(pids(environment), ElementsAre(1, 2, 3, 4));
  environment.runtime_directory = dir / "run/porttape/robot";
  EXPECT_THAT(pids(environment), ElementsAre(2));
}

TEST(ControlPlace, AFolderThatAnotherUserHasMadeInTmpIsNotBelieved) {
  const TempDir dir;
  const uid_t user = ::geteuid() + 1;
  const ControlEnvironment environment{.user = user, .run = dir / "run", .tmp = dir / "tmp"};
  make_socket(dir / ("tmp/porttape-" + std::to_string(user) + "/4.sock"));
  EXPECT_THAT(pids(environment), ElementsAre());
}

TEST(ControlPlace, RootTakesAUsersFolderOnlyIfItIsThatUsers) {
  const TempDir dir;
  const ControlEnvironment environment{.user = 0, .run = dir / "run", .tmp = dir / "tmp"};
  const std::string self = std::to_string(::geteuid());
  const std::string other = std::to_string(::geteuid() + 1);
  make_socket(dir / ("tmp/porttape-" + self + "/1.sock"));
  make_socket(dir / ("tmp/porttape-" + other + "/2.sock"));
  make_socket(dir / "tmp/porttape-x/3.sock");
  make_socket(dir / ("run/user/" + self + "/porttape/4.sock"));
  make_socket(dir / ("run/user/" + other + "/porttape/5.sock"));
  const OtherUsers all{.all = true};
  EXPECT_THAT(pids(environment, all), ElementsAre(1, 4));
  EXPECT_EQ(control_sockets(environment, all).front().owner, ::geteuid());
  const std::filesystem::path own = dir / ("tmp/porttape-" + self);
  std::filesystem::rename(own, dir / "elsewhere");
  std::filesystem::create_directory_symlink(dir / "elsewhere", own);
  EXPECT_THAT(pids(environment, all), ElementsAre(4));
}

// As systemd makes it for a unit with DynamicUser=.
TEST(ControlPlace, AFolderThatIsGivenMayBeALink) {
  const TempDir dir;
  make_socket(dir / "private/1.sock");
  std::filesystem::create_directory_symlink(dir / "private", dir / "given");
  EXPECT_THAT(pids({.user = ::geteuid(), .runtime_directory = dir / "given"}), ElementsAre(1));
}

TEST(ControlPlace, RootLooksAtNobodyElsesUnlessItSaysWhose) {
  const TempDir dir;
  const uid_t user = ::geteuid() + 1;  // as whom root counts here
  const std::string self = std::to_string(::geteuid());
  const ControlEnvironment root{
      .user = 0, .xdg_runtime_dir = dir / "xdg", .run = dir / "run", .tmp = dir / "tmp"};
  make_socket(dir / "run/porttape/1.sock");
  make_socket(dir / "run/porttape/robot/2.sock");
  make_socket(dir / ("run/user/" + self + "/porttape/3.sock"));
  make_socket(dir / ("tmp/porttape-" + self + "/4.sock"));
  make_socket(dir / "xdg/porttape/5.sock");
  if (::geteuid() != 0) {
    EXPECT_THAT(pids(root), ElementsAre(1, 2));
  }
  EXPECT_THAT(pids(root, {.one = ::geteuid()}), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(pids(root, {.all = true}), ElementsAre(1, 2, 3, 4));
  ControlEnvironment other = root;
  other.user = user;
  EXPECT_THAT(pids(other), ElementsAre(1, 2, 5));
  EXPECT_THAT(pids(other, {.one = ::geteuid()}), ElementsAre(1, 2, 3, 4, 5));
  other.runtime_directory = dir / "xdg/porttape";
  EXPECT_THAT(pids(other), ElementsAre(5)) << "that alone";
  EXPECT_THAT(pids(other, {.one = ::geteuid()}), ElementsAre(3, 4, 5));
}

TEST(ControlPlace, AUserIsGivenByNameOrNumber) {
  EXPECT_TRUE(OtherUsers::parse("all")->all);
  EXPECT_EQ(OtherUsers::parse("12345")->one, 12345U);
  EXPECT_EQ(OtherUsers::parse("root")->one, 0U);
  const Result<OtherUsers> nobody = OtherUsers::parse("no such user");
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error().code, Errc::usage);
  EXPECT_EQ(nobody.error().message, "there is no user 'no such user'");
}

}  // namespace
}  // namespace porttape
