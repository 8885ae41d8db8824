#include "libport/base/own_name.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <optional>
#include <string>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class OwnName : public testing::Test {
 protected:
  std::string make(const std::string& name, const std::string& content) const {
    test::write_file(dir / name, as_bytes(content));
    return dir / name;
  }
  [[nodiscard]] std::string content_of(const std::string& path) const {
    const Bytes bytes = test::read_file(path);
    return std::string(as_text(bytes));
  }
  [[nodiscard]] static FileIdentity identity_of(const std::string& path) {
    return FileIdentity::at(AT_FDCWD, path).value_or(FileIdentity{});
  }

  test::TempDir dir;
};

TEST_F(OwnName, AFileIsTheSameUnderEachOfItsNamesAndWhereItIsOpen) {
  const std::string path = make("one", "1");
  const UniqueFd folder(::open(dir.path().c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  const UniqueFd by_path(::open(path.c_str(), O_PATH | O_CLOEXEC));
  fs::create_hard_link(path, dir / "two");
  for (const auto& other : {FileIdentity::at(folder.get(), "one"), FileIdentity::at(folder.get(), "two"),
                            FileIdentity::of(fd.get()), FileIdentity::of(by_path.get())})
    EXPECT_EQ(other, identity_of(path));
  EXPECT_NE(identity_of(make("three", "1")), identity_of(path));
}

TEST_F(OwnName, OfALinkItIsTheLink) {
  const std::string path = make("file", "1");
  fs::create_symlink(path, dir / "link");
  EXPECT_NE(identity_of(dir / "link"), identity_of(path));
  fs::create_symlink("nowhere", dir / "dangling");
  EXPECT_TRUE(FileIdentity::at(AT_FDCWD, dir / "dangling").has_value());
}

TEST_F(OwnName, ALinkHasItsText) {
  const std::string text(3000, 'x');
  std::filesystem::create_symlink(text, dir / "long");
  EXPECT_EQ(link_text(AT_FDCWD, dir / "long"), text);
  const UniqueFd link(::open((dir / "long").c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
  EXPECT_EQ(link_text(link.get(), {}), text);
  EXPECT_EQ(link_text(AT_FDCWD, dir / "none"), "");
  EXPECT_EQ(link_text(AT_FDCWD, dir.path().string()), "");
}

TEST_F(OwnName, WhereNothingIsErrnoSaysSo) {
  errno = 0;
  EXPECT_FALSE(FileIdentity::at(AT_FDCWD, dir / "none").has_value());
  EXPECT_EQ(errno, ENOENT);
  EXPECT_FALSE(FileIdentity::of(-1).has_value());
  EXPECT_EQ(errno, EBADF);
}

TEST_F(OwnName, NoOtherFileIsTheSameWhileItIsOpen) {
  const std::string path = dir / "file";
  for (int n = 0; n < 20; ++n) {
    make("file", "old");
    const FileIdentity old = identity_of(path);
    const UniqueFd open(::open(path.c_str(), O_PATH | O_CLOEXEC));
    fs::remove(path);
    make("file", "new");
    ASSERT_FALSE(remove_if_same(AT_FDCWD, path, old));
    ASSERT_EQ(content_of(path), "new");
    ASSERT_FALSE(remove_if_same(AT_FDCWD, path, open.get()));
    ASSERT_TRUE(remove_if_same(AT_FDCWD, path, identity_of(path)));
    ASSERT_FALSE(fs::exists(path));
  }
}

TEST_F(OwnName, AnOpenFileIsRemovedByItsDescriptor) {
  const std::string path = make("file", "1");
  const UniqueFd open(::open(path.c_str(), O_PATH | O_CLOEXEC));
  EXPECT_FALSE(remove_if_same(AT_FDCWD, path, -1));
  EXPECT_TRUE(fs::exists(path));
  EXPECT_TRUE(remove_if_same(AT_FDCWD, path, open.get()));
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(OwnName, AFreeNameIsTakenAndATakenOneIsLeft) {
  const std::string from = make("from", "new");
  const std::string to = dir / "to";
  EXPECT_EQ(move_to_free_name(AT_FDCWD, from, to), 0);
  EXPECT_EQ(content_of(to), "new");
  EXPECT_FALSE(fs::exists(from));
  make("from", "newer");
  EXPECT_EQ(move_to_free_name(AT_FDCWD, from, to), EEXIST);
  EXPECT_EQ(content_of(to), "new");
  EXPECT_EQ(content_of(from), "newer");
  EXPECT_EQ(move_to_free_name(AT_FDCWD, dir / "none", dir / "other"), ENOENT);
}

TEST_F(OwnName, WhatIsReplacedIsWhatWasMeant) {
  const std::string from = make("from", "new");
  const std::string to = make("to", "old");
  const FileIdentity old = identity_of(to);
  const FileIdentity moved = identity_of(from);
  EXPECT_EQ(move_over(AT_FDCWD, from, to, std::nullopt), EEXIST);
  EXPECT_EQ(move_over(AT_FDCWD, from, to, moved), EEXIST);
  EXPECT_EQ(content_of(to), "old");
  EXPECT_EQ(move_over(AT_FDCWD, from, to, old), 0);
  EXPECT_EQ(identity_of(to), moved);
  EXPECT_FALSE(fs::exists(from));
  fs::remove(to);
  make("from", "third");
  EXPECT_EQ(move_over(AT_FDCWD, from, to, moved), 0) << "nothing is there any more";
  EXPECT_EQ(content_of(to), "third");
}

TEST_F(OwnName, WithoutFlagsOfRenameOrLinksTheSameHolds) {
  const std::string from = make("from", "new");
  const std::string to = dir / "to";
  const test::RefusedCall no_flags{SYS_renameat2, EINVAL};
  for (const std::vector<test::RefusedCall>& lacks :
       {std::vector{no_flags}, {no_flags, {SYS_linkat, EPERM}}, {no_flags, {SYS_linkat, EOPNOTSUPP}}}) {
    EXPECT_TRUE(test::holds_without(lacks, [&] {
      EXPECT_EQ(exchange_names(AT_FDCWD, from, to), EINVAL);
      EXPECT_EQ(move_to_free_name(AT_FDCWD, from, to), 0);
      make("from", "newer");
      EXPECT_EQ(move_to_free_name(AT_FDCWD, from, to), EEXIST);
      EXPECT_EQ(move_over(AT_FDCWD, from, to, identity_of(from)), EEXIST);
      EXPECT_EQ(move_over(AT_FDCWD, from, to, identity_of(to)), 0);
    }));
    EXPECT_EQ(content_of(to), "newer");
    EXPECT_FALSE(fs::exists(from));
    fs::rename(to, from);
  }
  EXPECT_TRUE(test::holds_without({no_flags, {SYS_linkat, EMLINK}},
                                  [&] { EXPECT_EQ(move_to_free_name(AT_FDCWD, from, to), EMLINK); }));
}

TEST_F(OwnName, WhatCannotBeRemovedComesBack) {
  const std::string from = make("from", "new");
  const std::string to = make("to", "old");
  EXPECT_TRUE(test::holds_without({{SYS_unlinkat, EPERM}}, [&] {
    EXPECT_EQ(move_over(AT_FDCWD, from, to, identity_of(to)), EEXIST);
    EXPECT_FALSE(remove_if_same(AT_FDCWD, to, identity_of(to)));
  }));
  EXPECT_EQ(content_of(to), "old");
  EXPECT_EQ(content_of(from), "new");
}

}  // namespace
}  // namespace porttape
