#include "libport/base/trusted_folder.hpp"

#include <fcntl.h>
#include <filesystem>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/own_name.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class TrustedFolder : public testing::Test {
 protected:
  void expect_leads_to(const std::string& path, const std::string& folder) {
    const Result<UniqueFd> opened = open_trusted_folder(path);
    ASSERT_TRUE(opened.has_value()) << path << ": " << opened.error().message;
    const UniqueFd direct(::open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
    EXPECT_EQ(FileIdentity::of(opened->get()), FileIdentity::of(direct.get())) << path;
  }
  static std::string error_of(const std::string& path) {
    const Result<UniqueFd> opened = open_trusted_folder(path);
    EXPECT_TRUE(!opened && opened.error().code == Errc::usage) << path;
    return opened ? std::string() : opened.error().message;
  }

  test::TempDir dir;
};

TEST_F(TrustedFolder, EachWayThereThatIsOursLeadsThere) {
  const std::string folder = dir / "one/two";
  fs::create_directories(folder);
  fs::create_symlink("one", dir / "relative");
  fs::create_symlink(folder, dir / "absolute");
  fs::create_symlink("../relative/./two", dir / "one/back");
  expect_leads_to(folder, folder);
  expect_leads_to(folder + "/", folder);
  expect_leads_to(folder + "/../two/.", folder);
  expect_leads_to(dir / "relative/two", folder);
  expect_leads_to(dir / "absolute", folder);
  expect_leads_to(dir / "one/back", folder);
  expect_leads_to("/", "/");
  expect_leads_to(".", ".");
}

TEST_F(TrustedFolder, WhereTheWorkingFolderIsGoneARelativeNameIsAnError) {
  const fs::path before = fs::current_path();
  fs::create_directory(dir / "gone");
  fs::current_path(dir / "gone");
  fs::remove(dir / "gone");
  const Result<TrustedName> found = find_trusted_name("port");
  const Result<TrustedName> absolute = find_trusted_name(dir / "port");
  fs::current_path(before);
  ASSERT_FALSE(found.has_value());
  EXPECT_EQ(found.error().code, Errc::usage);
  EXPECT_TRUE(absolute.has_value());
}

TEST_F(TrustedFolder, ANameIsLookedForInItAndNotFollowed) {
  fs::create_directory(dir / "one");
  fs::create_symlink("one", dir / "link");
  fs::create_symlink("nowhere", dir / "one/port");
  const Result<TrustedName> found = find_trusted_name(dir / "link/port");
  ASSERT_TRUE(found.has_value()) << found.error().message;
  EXPECT_EQ(found->name, "port");
  EXPECT_EQ(FileIdentity::of(found->folder.get()), FileIdentity::at(AT_FDCWD, dir / "one"));
  const Result<TrustedName> nowhere = find_trusted_name(dir / "none/port");
  ASSERT_FALSE(nowhere.has_value());
  EXPECT_EQ(nowhere.error().message, "its folder does not exist; type mkdir -p " + (dir / "none"));
}

TEST_F(TrustedFolder, WhatLeadsNowhereSaysWhy) {
  test::write_file(dir / "file", {});
  fs::create_symlink("loop", dir / "loop");
  fs::create_symlink("none", dir / "dangling");
  EXPECT_EQ(error_of(dir / "none/two"), "its folder does not exist; type mkdir -p " + (dir / "none/two"));
  EXPECT_EQ(error_of(dir / "dangling"), "its folder does not exist; type mkdir -p " + (dir / "dangling"));
  EXPECT_EQ(error_of(dir / "file"), "its folder: Not a directory");
  EXPECT_EQ(error_of(dir / "file/two"), "its folder: Not a directory");
  EXPECT_EQ(error_of(dir / "loop"), "its folder: Too many levels of symbolic links");
}

TEST_F(TrustedFolder, FortyLinksAreFollowedAsTheKernelDoes) {
  fs::create_directory(dir / "0");
  for (int n = 1; n <= 41; ++n) fs::create_symlink(std::to_string(n - 1), dir / std::to_string(n));
  expect_leads_to(dir / "40", dir / "0");
  EXPECT_EQ(error_of(dir / "41"), "its folder: Too many levels of symbolic links");
}

TEST_F(TrustedFolder, AnotherUsersLinkIsNotFollowed) {
  fs::create_directory(dir / "folder");
  fs::create_symlink("folder", dir / "link");
  const std::string link = dir / "link";
  if (::lchown(link.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "needs root, to give a link away";
  EXPECT_EQ(error_of(link),
            "'link' on the way there is a link that another user made; name the folder itself");
}

}  // namespace
}  // namespace porttape
