#include "libport/tape/new_file.hpp"

#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::string content_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(NewFileTest, AppearsWholeOrNotAtAll) {
  const test::TempDir dir;
  {
    auto file = NewFile::create(dir / "x", false);
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->add(std::string(1'000'000, 'x')));
    EXPECT_FALSE(fs::exists(std::string(dir / "x")));
  }
  EXPECT_TRUE(fs::is_empty(std::string(dir / ".")));
  auto file = NewFile::create(dir / "x", false);
  NewFile moved = std::move(*file);
  ASSERT_TRUE(moved.add(std::string_view("ab")));
  ASSERT_TRUE(moved.add(as_bytes("cd")));
  ASSERT_TRUE(moved.finish());
  EXPECT_EQ(content_of(dir / "x"), "abcd");
  EXPECT_EQ(moved.size(), 4U);
}

TEST(NewFileTest, WhatIsThereStaysUntilItIsToBeReplaced) {
  const test::TempDir dir;
  test::write_file(dir / "x", test::bytes_of("old"));
  EXPECT_THAT(NewFile::create(dir / "x", false).error().message, HasSubstr("--overwrite"));
  auto file = NewFile::create(dir / "x", true);
  ASSERT_TRUE(file && file->add(std::string_view("new")));
  EXPECT_EQ(content_of(dir / "x"), "old");
  ASSERT_TRUE(file->finish());
  EXPECT_EQ(content_of(dir / "x"), "new");
  fs::create_symlink("x", std::string(dir / "link"));
  EXPECT_THAT(NewFile::create(dir / "link", true).error().message, HasSubstr("no regular file"));
  EXPECT_THAT(NewFile::create(dir / "none/x", false).error().message,
              HasSubstr("its folder does not exist; type mkdir -p"));
}

TEST(NewFileTest, SomebodyElsesFileOfThatNameStays) {
  const test::TempDir dir;
  auto file = NewFile::create(dir / "x", false);
  ASSERT_TRUE(file && file->add(std::string_view("ours")));
  test::write_file(dir / "x", test::bytes_of("theirs"));
  EXPECT_THAT(file->finish().error().message, HasSubstr("somebody else"));
  EXPECT_EQ(content_of(dir / "x"), "theirs");
}

TEST(NewFileTest, AFullDiskIsTold) {
  if (::access("/dev/full", W_OK) != 0) GTEST_SKIP() << "no /dev/full here";
  const test::TempDir dir;
  const int kept = ::dup(STDOUT_FILENO);
  const int full = ::open("/dev/full", O_WRONLY | O_CLOEXEC);
  ::dup2(full, STDOUT_FILENO);
  auto file = NewFile::create("-", false);
  const auto added = file->add(std::string(1'000'000, 'x'));
  const auto finished = file->finish();
  ::dup2(kept, STDOUT_FILENO);
  ::close(kept);
  ::close(full);
  ASSERT_FALSE(added);
  EXPECT_THAT(added.error().message, HasSubstr("No space left"));
  EXPECT_FALSE(finished);
}

}  // namespace
}  // namespace porttape
