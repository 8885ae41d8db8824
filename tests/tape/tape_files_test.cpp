#include "libport/tape/tape_files.hpp"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <string>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_lock.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_folder.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;
using Appear = NewTapeFiles::Appear;

class NewTapeFilesTest : public test::TapeFolder {
 protected:
  void write_old() const { write_all(paths, "old"); }
  static Result<NewTapeFiles> make(const TapePaths& paths, OnExisting on_existing,
                                   Appear appear = Appear::at_once) {
    return NewTapeFiles::make(paths, {.on_existing = on_existing, .sync = false}, appear);
  }
  static void fill(NewTapeFiles& files) {
    files.sinks.read->append({}, as_bytes("r"));
    files.sinks.write->append({}, as_bytes("w"));
    files.sinks.events->append({}, as_bytes("e"));
  }
  void expect_new() const {
    EXPECT_EQ(content_of(paths.read), "r");
    EXPECT_EQ(content_of(paths.write), "w");
    EXPECT_EQ(content_of(paths.events), "e");
    EXPECT_EQ(names().size(), 3U);
  }

  TapePaths paths = literal_tape(dir / "t.log");
};

TEST_F(NewTapeFilesTest, AreThereAtOnceAndGoUnlessPublished) {
  for (const bool published : {false, true}) {
    {
      auto files = make(paths, OnExisting::refuse);
      ASSERT_TRUE(files);
      EXPECT_EQ(files->paths, paths);
      EXPECT_THAT(names(), ElementsAre("t.loge", "t.logr", "t.logw"));
      for (const fs::path& path : {paths.read, paths.write, paths.events})
        EXPECT_TRUE(is_being_written(path));
      fill(*files);
      if (published) {
        EXPECT_TRUE(files->publish());
      }
    }
    EXPECT_EQ(names().size(), published ? 3U : 0U);
  }
  expect_new();
}

TEST_F(NewTapeFilesTest, WhatIsToBeReplacedStaysUntouchedUntilThenAndIsLocked) {
  write_old();
  {
    auto files = make(paths, OnExisting::overwrite);
    ASSERT_TRUE(files);
    fill(*files);
    EXPECT_EQ(names().size(), 6U);
    for (const std::string& name : names()) {
      const bool of_old = name == "t.logr" || name == "t.logw" || name == "t.loge";
      EXPECT_TRUE(of_old || name.starts_with(".t.log")) << name;
      if (of_old) {
        EXPECT_EQ(content_of(dir / name), "old");
      }
      EXPECT_TRUE(is_being_written(fs::path(dir / name))) << name;
    }
    EXPECT_FALSE(make(paths, OnExisting::overwrite));
    EXPECT_EQ(names().size(), 6U);
    files->discard();
    EXPECT_EQ(names().size(), 3U);
  }
  auto files = make(paths, OnExisting::overwrite);
  ASSERT_TRUE(files);
  fill(*files);
  EXPECT_TRUE(files->publish());
  expect_new();
}

TEST_F(NewTapeFilesTest, WhatAppearsWhenPublishedIsNotSeenBefore) {
  {
    const auto files = make(paths, OnExisting::refuse, Appear::when_published);
    ASSERT_TRUE(files);
    EXPECT_THAT(names(), IsEmpty());
  }
  auto files = make(paths, OnExisting::refuse, Appear::when_published);
  ASSERT_TRUE(files);
  fill(*files);
  EXPECT_TRUE(files->publish());
  expect_new();
  auto other = make(paths, OnExisting::overwrite, Appear::when_published);
  ASSERT_TRUE(other);
  other->sinks.read->append({}, as_bytes("new"));
  EXPECT_EQ(names().size(), 3U);
  EXPECT_TRUE(other->publish());
  EXPECT_EQ(names().size(), 3U);
  EXPECT_EQ(content_of(paths.read), "new");
}

TEST_F(NewTapeFilesTest, ANameThatIsTakenMeanwhileIsLeftToWhoHasItAndNoneAppears) {
  for (const fs::path& taken : {paths.read, paths.write, paths.events}) {
    auto files = make(paths, OnExisting::refuse, Appear::when_published);
    ASSERT_TRUE(files);
    test::write_file(taken, test::bytes_of("theirs"));
    const auto published = files->publish();
    ASSERT_FALSE(published);
    EXPECT_EQ(published.error(),
              make_error(Errc::usage, "cannot make the tape: '" + taken.string() +
                                          "' has come into being meanwhile; take another name"));
    EXPECT_THAT(names(), ElementsAre(taken.filename().string()));
    EXPECT_EQ(content_of(taken), "theirs");
    fs::remove(taken);
  }
}

TEST_F(NewTapeFilesTest, AFolderThatIsGoneMeanwhileIsTold) {
  const TapePaths inner = literal_tape(dir / "f/t.log");
  fs::create_directory(dir / "f");
  auto files = make(inner, OnExisting::refuse, Appear::when_published);
  ASSERT_TRUE(files);
  fs::remove(dir / "f");
  EXPECT_EQ(files->publish().error(),
            make_error(Errc::io, "cannot make '" + inner.events.string() + "': No such file or directory"));
}

TEST_F(NewTapeFilesTest, WhatWasReplacedBeforeTheErrorIsTheNewTapes) {
  for (const Appear appear : {Appear::at_once, Appear::when_published}) {
    write_old();
    auto files = make(paths, OnExisting::overwrite, appear);
    ASSERT_TRUE(files);
    fill(*files);
    fs::remove(paths.read);
    fs::create_directory(paths.read);
    const auto published = files->publish();
    EXPECT_EQ(published.error(),
              make_error(Errc::usage, "cannot make the tape: '" + paths.read.string() +
                                          "' has come into being meanwhile; take another name"));
    EXPECT_THAT(names(), ElementsAre("t.loge", "t.logr", "t.logw"));
    EXPECT_EQ(content_of(paths.events), "e");
    EXPECT_EQ(content_of(paths.write), "w");
    fs::remove(paths.read);
  }
}

std::string refused(const TapePaths& paths, OnExisting on_existing = OnExisting::refuse) {
  const auto checked = check_tape_files(paths, on_existing);
  const auto made = NewTapeFiles::make(paths, {.on_existing = on_existing, .sync = false});
  EXPECT_EQ(checked.error(), made.error());
  EXPECT_EQ(checked.error().code, Errc::usage);
  return checked.error().message;
}

TEST_F(NewTapeFilesTest, AFolderThatIsMissingIsNamedWithWhatMakesIt) {
  EXPECT_EQ(refused(literal_tape(dir / "no two/t")), "cannot make the tape: '" + (dir / "no two/tr") +
                                                         "': its folder does not exist; type mkdir -p '" +
                                                         (dir / "no two") + "'");
  test::write_file(dir / "file", {});
  EXPECT_EQ(refused(literal_tape(dir / "file/t")),
            "cannot make the tape: '" + (dir / "file/tr") + "': its folder: Not a directory");
}

TEST_F(NewTapeFilesTest, AFolderThatIsNotWritableIsNamed) {
  const fs::path folder = dir / "folder";
  fs::create_directory(folder);
  fs::permissions(folder, fs::perms::owner_read | fs::perms::owner_exec);
  const bool root = ::geteuid() == 0;
  fs::permissions(dir.path(), fs::perms::all);
  if (root && ::seteuid(65'534) != 0) GTEST_SKIP() << "no other user to be here";
  const std::string message = refused(literal_tape((folder / "t").string()));
  if (root) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  EXPECT_EQ(message,
            "cannot make the tape: the folder '" + folder.string() + "' is not writable: Permission denied");
}

TEST_F(NewTapeFilesTest, APathWithoutAFileIsRefused) {
  TapePaths nameless = paths;
  nameless.write = dir / "";
  EXPECT_EQ(refused(nameless), "cannot make the tape: '" + (dir / "") + "' names no file");
}

TEST_F(NewTapeFilesTest, AnyOfTheThreeNamesMayBeInTheWay) {
  for (const fs::path& path : {paths.read, paths.write, paths.events}) {
    const std::string name = "cannot make the tape: '" + path.string() + "' ";
    test::write_file(path, {});
    EXPECT_EQ(refused(paths),
              name +
                  "exists; take another name, or --on-existing next for a numbered one, or --overwrite to "
                  "replace the tape");
    EXPECT_TRUE(check_tape_files(paths, OnExisting::overwrite));
    fs::remove(path);
    fs::create_directory(path);
    for (const OnExisting how : {OnExisting::refuse, OnExisting::overwrite})
      EXPECT_EQ(refused(paths, how), name + "is not a regular file; take another name");
    EXPECT_TRUE(check_tape_files(paths, OnExisting::next));
    fs::remove(path);
    fs::create_symlink("nowhere", path);
    for (const OnExisting how : {OnExisting::refuse, OnExisting::overwrite})
      EXPECT_EQ(refused(paths, how),
                name + "is a symbolic link, which is never written through; remove it or take another name");
    EXPECT_TRUE(check_tape_files(paths, OnExisting::next));
    fs::remove(path);
  }
  EXPECT_THAT(names(), IsEmpty());
}

TEST_F(NewTapeFilesTest, ANameThatCannotBeLookedAtIsToldWithWhy) {
  const std::string longest(300, 'x');
  EXPECT_EQ(refused(literal_tape(dir / longest)),
            "cannot make the tape: '" + (dir / (longest + "r")) + "': File name too long");
}

TEST_F(NewTapeFilesTest, WhatIsBeingWrittenIsLeftAlone) {
  const auto live = make(paths, OnExisting::refuse);
  ASSERT_TRUE(live);
  for (const OnExisting how : {OnExisting::refuse, OnExisting::overwrite})
    EXPECT_EQ(refused(paths, how),
              "cannot make the tape: '" + paths.read.string() +
                  "' is being written by another recording, which cannot be replaced; end that one first, or "
                  "take another name");
}

TEST_F(NewTapeFilesTest, NextTakesTheFirstNameOfWhichNoneOfTheThreeIsThere) {
  test::write_file(numbered_tape(paths, 1).write, {});
  fs::create_symlink("nowhere", numbered_tape(paths, 2).events);
  fs::create_directory(numbered_tape(paths, 3).read);
  const auto files = make(paths, OnExisting::next);
  ASSERT_TRUE(files);
  EXPECT_EQ(files->paths, numbered_tape(paths, 4));
  const auto later = NewTapeFiles::make(paths, {.on_existing = OnExisting::next, .first_number = 7});
  ASSERT_TRUE(later);
  EXPECT_EQ(later->paths, numbered_tape(paths, 7));
}

TEST_F(NewTapeFilesTest, WhereAFileCannotBeMadeNoneIsLeft) {
  TapePaths long_name = paths;
  long_name.events = dir / std::string(250, 'x');  // whose hidden name is too long
  test::write_file(long_name.events, {});
  const auto files = make(long_name, OnExisting::overwrite);
  ASSERT_FALSE(files);
  EXPECT_EQ(files.error(),
            make_error(Errc::io, "cannot make '" + long_name.events.string() + "': File name too long"));
  EXPECT_EQ(names().size(), 1U);
}

class TapeLockOfAFile : public testing::Test {
 protected:
  TapeLockOfAFile() { test::write_file(path, {}); }
  [[nodiscard]] UniqueFd open(int flags = O_WRONLY) const {
    return UniqueFd(::open(path.c_str(), flags | O_CLOEXEC));
  }

  test::TempDir dir;
  const fs::path path = dir / "f";
};

TEST_F(TapeLockOfAFile, IsHeldByOneDescriptorAtATime) {
  const UniqueFd one = open();
  const UniqueFd other = open();
  EXPECT_FALSE(is_being_written(path));
  EXPECT_EQ(lock_tape_file(one.get(), AT_FDCWD, path), TapeLock::held);
  EXPECT_EQ(lock_tape_file(one.get(), AT_FDCWD, path), TapeLock::held);
  EXPECT_EQ(lock_tape_file(other.get(), AT_FDCWD, path), TapeLock::taken);
  EXPECT_TRUE(is_being_written(path));
}

TEST_F(TapeLockOfAFile, IsOfAnotherFileOnceTheNameHasMoved) {
  const UniqueFd file = open();
  fs::rename(path, dir / "g");
  EXPECT_EQ(lock_tape_file(file.get(), AT_FDCWD, path), TapeLock::moved);
  test::write_file(path, {});
  EXPECT_EQ(lock_tape_file(file.get(), AT_FDCWD, path), TapeLock::moved);
  EXPECT_EQ(lock_tape_file(file.get(), AT_FDCWD, fs::path(dir / "g")), TapeLock::held);
  fs::remove(path);
  fs::create_symlink(dir / "g", path);
  EXPECT_EQ(lock_tape_file(file.get(), AT_FDCWD, path), TapeLock::moved) << "a link is another file";
}

TEST_F(TapeLockOfAFile, CannotBeHadByWhoMayNotWriteOrWhereTheNameCannotBeLookedAt) {
  const UniqueFd reads = open(O_RDONLY);
  EXPECT_EQ(lock_tape_file(reads.get(), AT_FDCWD, path), TapeLock::failed);
  EXPECT_EQ(errno, EBADF);
  const UniqueFd file = open();
  EXPECT_EQ(lock_tape_file(file.get(), AT_FDCWD, path / "x"), TapeLock::failed);
  EXPECT_EQ(errno, ENOTDIR);
}

TEST_F(TapeLockOfAFile, OfAnyOfTheThreeFilesIsThatOfTheTape) {
  const TapePaths tape = literal_tape(dir / "t");
  for (const fs::path& each : {tape.read, tape.write, tape.events}) {
    EXPECT_FALSE(is_being_written(tape));
    test::write_file(each, {});
    const UniqueFd file(::open(each.c_str(), O_WRONLY | O_CLOEXEC));
    EXPECT_EQ(lock_tape_file(file.get(), AT_FDCWD, each), TapeLock::held);
    EXPECT_TRUE(is_being_written(tape));
  }
  EXPECT_FALSE(is_being_written(tape));
}

TEST_F(TapeLockOfAFile, OfTheLastByteIsThatOfTheFile) {
  const UniqueFd other = open(O_RDWR);
  struct flock far {};
  far.l_type = F_RDLCK;
  far.l_whence = SEEK_SET;
  far.l_start = 1'000'000'000;
  ASSERT_EQ(::fcntl(other.get(), F_OFD_SETLK, &far), 0);
  EXPECT_FALSE(is_being_written(path)) << "who only reads writes nothing";
  EXPECT_EQ(lock_tape_file(open().get(), AT_FDCWD, path), TapeLock::read);
  far.l_type = F_WRLCK;
  ASSERT_EQ(::fcntl(other.get(), F_OFD_SETLK, &far), 0);
  EXPECT_TRUE(is_being_written(path));
  EXPECT_EQ(lock_tape_file(open().get(), AT_FDCWD, path), TapeLock::taken);
}

}  // namespace
}  // namespace porttape
