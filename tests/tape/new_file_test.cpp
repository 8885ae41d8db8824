#include "libport/tape/new_file.hpp"

#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_lock.hpp"
#include "libport/tape/tape_writer.hpp"
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

unsigned mode_of(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 ? status.st_mode & 0777U : 0U;
}

TEST(NewFileTest, KeepsFromTheGroupWhatOneOfItsSourcesDoes) {
  const test::TempDir dir;
  const TapePaths tape = literal_tape(dir / "t.log");
  test::write_file(tape.read, test::bytes_of("r"));
  test::write_file(tape.events, test::bytes_of("e"));
  ASSERT_EQ(::chmod(tape.read.c_str(), 0644), 0);
  ASSERT_EQ(::chmod(tape.events.c_str(), 0600), 0);
  auto file = NewFile::create(dir / "x", false);
  ASSERT_TRUE(file && file->made_of(tape) && file->finish());
  EXPECT_EQ(mode_of(dir / "x"), 0600U);
  auto other = NewFile::create(dir / "y", false);
  ASSERT_TRUE(other && other->made_of(tape.read.string()) && other->finish());
  EXPECT_EQ(mode_of(dir / "y") & 07U, 0U);
}

TEST(NewFileTest, KeepsFromTheGroupWhatTheReplacedFileDoes) {
  const test::TempDir dir;
  test::write_file(dir / "x", test::bytes_of("old"));
  ASSERT_EQ(::chmod((dir / "x").c_str(), 0600), 0);
  auto file = NewFile::create(dir / "x", true);
  ASSERT_TRUE(file && file->finish());
  EXPECT_EQ(mode_of(dir / "x"), 0600U);
}

TEST(NewFileTest, InAFolderItStaysThereWhateverThePathMeans) {
  const test::TempDir dir;
  fs::create_directory(dir / "folder");
  fs::create_directory(dir / "other");
  for (const bool overwrite : {false, true}) {
    UniqueFd folder(::open((dir / "folder").c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
    auto file = NewFile::create_in(std::move(folder), dir / "folder/x", overwrite);
    fs::rename(dir / "folder", dir / "moved");
    fs::create_symlink("other", dir / "folder");
    ASSERT_TRUE(file && file->add(std::string_view(overwrite ? "new" : "old")) && file->finish());
    fs::remove(dir / "folder");
    fs::rename(dir / "moved", dir / "folder");
    EXPECT_EQ(content_of(dir / "folder/x"), overwrite ? "new" : "old");
    EXPECT_TRUE(fs::is_empty(dir / "other"));
  }
  EXPECT_THAT(NewFile::create(dir / "folder/", true).error().message, HasSubstr("no regular file"));
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

TEST(NewFileTest, HasNoNameUntilItIsWhole) {
  const test::TempDir dir;
  test::write_file(dir / "x", test::bytes_of("old"));
  for (const bool overwrite : {false, true}) {
    auto file = NewFile::create(dir / (overwrite ? "x" : "y"), overwrite);
    ASSERT_TRUE(file && file->add(std::string(1'000'000, 'x')));
    EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 1);
  }
}

TEST(NewFileTest, ATapeThatIsBeingWrittenIsNotReplaced) {
  const test::TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  auto before = NewFile::create(paths.read.string(), false);
  ASSERT_TRUE(before);
  test::write_file(dir / "other", test::bytes_of("old"));
  auto meanwhile = NewFile::create(dir / "other", true);
  ASSERT_TRUE(meanwhile);
  auto tape = TapeWriter::create(paths, TapeHeader{}, {.sync = false});
  ASSERT_TRUE(tape);
  for (const fs::path& path : {paths.read, paths.write, paths.events}) {
    const auto file = NewFile::create(path.string(), true);
    ASSERT_FALSE(file);
    EXPECT_EQ(file.error().code, Errc::usage);
    EXPECT_THAT(file.error().message, HasSubstr("is being written by a recording"));
  }
  fs::rename(paths.read, std::string(dir / "other"));
  EXPECT_THAT(meanwhile->finish().error().message, HasSubstr("is being written by a recording"));
  EXPECT_TRUE(is_being_written(fs::path(dir / "other")));
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
