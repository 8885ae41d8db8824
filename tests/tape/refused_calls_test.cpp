// What the room does on systems that lack a call, a flag or a lock, or on which a call fails.

#include "tests/support/refused_calls.hpp"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <string>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/byte_source.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/tape/new_tape.hpp"
#include "libport/tape/tape_files.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_lock.hpp"
#include "libport/tape/tape_set.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_folder.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::holds_without;
using test::RefusedCall;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::MatchesRegex;

RefusedCall no_unnamed_files(int error) {
  return {SYS_openat, error, RefusedCall::Argument{2, O_TMPFILE, O_TMPFILE}};
}
RefusedCall no_rename_flags(int error) { return {SYS_renameat2, error}; }
RefusedCall no_command(int command, int error) {
  return {SYS_fcntl, error, RefusedCall::Argument{1, 0xffffffff, static_cast<std::uint32_t>(command)}};
}
std::vector<RefusedCall> no_look_at_descriptors(int error) {
  return {{SYS_fstat, error},
          {SYS_newfstatat, error, RefusedCall::Argument{3, AT_EMPTY_PATH, AT_EMPTY_PATH}}};
}

class RefusedCalls : public test::TapeFolder {
 protected:
  static Result<NewTapeFiles> make_files(const TapePaths& paths, OnExisting on_existing) {
    auto files = NewTapeFiles::make(paths, {.on_existing = on_existing, .sync = false},
                                    NewTapeFiles::Appear::when_published);
    if (files) {
      files->sinks.read->append({}, as_bytes("new"));
      files->sinks.write->append({}, as_bytes("new"));
      files->sinks.events->append({}, as_bytes("new"));
    }
    return files;
  }

  const TapePaths paths = literal_tape(dir / "t.log");
  const std::string file = dir / "file";
};

TEST_F(RefusedCalls, WithoutUnnamedFilesATapeHasHiddenNamesUntilItAppears) {
  for (const int error : {EISDIR, EINVAL, ENOENT, ENOSYS, EOPNOTSUPP}) {
    EXPECT_TRUE(holds_without({no_unnamed_files(error)}, [&] {
      {
        const auto files = make_files(paths, OnExisting::refuse);
        ASSERT_TRUE(files);
        EXPECT_EQ(names().size(), 3U);
        for (const std::string& name : names())
          EXPECT_THAT(name, MatchesRegex("\\.t\\.log[rwe]\\.new-[0-9]+-[0-9]+"));
      }
      EXPECT_THAT(names(), IsEmpty());
      auto files = make_files(paths, OnExisting::refuse);
      ASSERT_TRUE(files);
      EXPECT_TRUE(files->publish());
      EXPECT_THAT(names(), ElementsAre("t.loge", "t.logr", "t.logw"));
    })) << error;
    expect_all(paths, "new");
    for (const fs::path& path : {paths.read, paths.write, paths.events}) fs::remove(path);
  }
}

TEST_F(RefusedCalls, WithoutUnnamedFilesATapeIsReplacedByHiddenOnes) {
  write_all(paths, "old");
  EXPECT_TRUE(holds_without({no_unnamed_files(EOPNOTSUPP)}, [&] {
    auto files = make_files(paths, OnExisting::overwrite);
    ASSERT_TRUE(files);
    EXPECT_EQ(names().size(), 6U);
    expect_all(paths, "old");
    EXPECT_TRUE(files->publish());
  }));
  expect_all(paths, "new");
  EXPECT_EQ(names().size(), 3U);
}

TEST_F(RefusedCalls, WithoutUnnamedFilesANameThatIsTakenMeanwhileStays) {
  EXPECT_TRUE(holds_without({no_unnamed_files(EOPNOTSUPP)}, [&] {
    auto files = make_files(paths, OnExisting::refuse);
    ASSERT_TRUE(files);
    test::write_file(paths.read, test::bytes_of("theirs"));
    EXPECT_EQ(files->publish().error().code, Errc::usage);
  }));
  EXPECT_THAT(names(), ElementsAre("t.logr"));
  EXPECT_EQ(content_of(paths.read), "theirs");
}

TEST_F(RefusedCalls, WhereUnnamedFilesFailForAnotherReasonItIsTold) {
  EXPECT_TRUE(holds_without({no_unnamed_files(EDQUOT)}, [&] {
    EXPECT_EQ(make_files(paths, OnExisting::refuse).error(),
              make_error(Errc::io, "cannot make '" + paths.read.string() + "': Disk quota exceeded"));
    EXPECT_EQ(NewFile::create(file, false).error(),
              make_error(Errc::usage, "'" + file + "' cannot be made: Disk quota exceeded; name another"));
  }));
}

TEST_F(RefusedCalls, WithoutUnnamedFilesAFileHasAHiddenNameUntilItAppears) {
  for (const int error : {EOPNOTSUPP, EISDIR, EINVAL}) {
    for (const bool overwrite : {false, true}) {
      if (overwrite) test::write_file(file, test::bytes_of("old"));
      EXPECT_TRUE(holds_without({no_unnamed_files(error)}, [&] {
        const std::size_t before = names().size();
        {
          auto left = NewFile::create(file, overwrite);
          ASSERT_TRUE(left);
          EXPECT_THAT(names(), testing::Contains(MatchesRegex("\\.new-[0-9a-f]{16}")));
          struct stat status {};
          ASSERT_EQ(::stat((dir / names().front()).c_str(), &status), 0);
          EXPECT_EQ(status.st_mode & 07133U, 0U);
        }
        EXPECT_EQ(names().size(), before);
        auto made = NewFile::create(file, overwrite);
        ASSERT_TRUE(made && made->add(std::string_view("new")));
        EXPECT_TRUE(made->finish());
      })) << error;
      EXPECT_THAT(names(), ElementsAre("file"));
      EXPECT_EQ(content_of(file), "new");
      fs::remove(file);
    }
  }
}

TEST_F(RefusedCalls, WithoutUnnamedFilesSomebodyElsesFileStaysToo) {
  for (const bool flags : {true, false}) {
    std::vector<RefusedCall> calls{no_unnamed_files(EOPNOTSUPP)};
    if (!flags) calls.push_back(no_rename_flags(EINVAL));
    EXPECT_TRUE(holds_without(calls, [&] {
      auto made = NewFile::create(file, false);
      ASSERT_TRUE(made && made->add(std::string_view("ours")));
      test::write_file(file, test::bytes_of("theirs"));
      const Result<void> finished = made->finish();
      ASSERT_FALSE(finished);
      EXPECT_EQ(finished.error().code, Errc::usage) << "the caller may name another file";
      EXPECT_THAT(finished.error().message, HasSubstr("made by somebody else meanwhile"));
    }));
    EXPECT_THAT(names(), ElementsAre("file"));
    EXPECT_EQ(content_of(file), "theirs");
    fs::remove(file);
  }
}

TEST_F(RefusedCalls, WithoutARenameThatReplacesNothingAFileIsLinked) {
  EXPECT_TRUE(holds_without({no_unnamed_files(EOPNOTSUPP), no_rename_flags(EINVAL)}, [&] {
    auto made = NewFile::create(file, false);
    ASSERT_TRUE(made && made->add(std::string_view("new")));
    EXPECT_TRUE(made->finish());
    EXPECT_THAT(names(), ElementsAre("file"));
  }));
  EXPECT_EQ(content_of(file), "new");
}

TEST_F(RefusedCalls, WhereTheRenameFailsNothingIsLeft) {
  test::write_file(file, test::bytes_of("old"));
  EXPECT_TRUE(holds_without({no_rename_flags(EIO), {SYS_renameat, EIO}}, [&] {
    auto made = NewFile::create(file, true);
    ASSERT_TRUE(made && made->add(std::string_view("new")));
    EXPECT_EQ(made->finish().error(),
              make_error(Errc::io, "'" + file + "' cannot be written: Input/output error"));
  }));
  EXPECT_EQ(content_of(file), "old");
  EXPECT_TRUE(holds_without({no_unnamed_files(EOPNOTSUPP), no_rename_flags(EIO)}, [&] {
    auto made = NewFile::create(dir / "other", false);
    ASSERT_TRUE(made);
    EXPECT_FALSE(made->finish());
  }));
  EXPECT_THAT(names(), ElementsAre("file"));
}

TEST_F(RefusedCalls, AFileSystemThatCannotSyncIsNoFailureAndOneThatFailsIs) {
  EXPECT_TRUE(holds_without({{SYS_fsync, EINVAL}}, [&] {
    auto made = NewFile::create(file, false);
    ASSERT_TRUE(made);
    EXPECT_TRUE(made->finish());
  }));
  EXPECT_TRUE(holds_without({{SYS_fsync, EIO}}, [&] {
    auto made = NewFile::create(dir / "other", false);
    ASSERT_TRUE(made);
    const std::string why = "'" + (dir / "other") + "' cannot be written: Input/output error";
    EXPECT_EQ(made->finish().error(), make_error(Errc::io, why));
    EXPECT_EQ(made->finish().error(), make_error(Errc::io, why)) << "an error stays";
    EXPECT_EQ(made->add(std::string_view("x")).error(), make_error(Errc::io, why));
  }));
  EXPECT_THAT(names(), ElementsAre("file"));
  for (const auto& [error, wanted] : {std::pair(EINVAL, 0), std::pair(ENOSYS, 0), std::pair(EIO, EIO)}) {
    EXPECT_TRUE(holds_without({{SYS_fdatasync, error}}, [&, error = error, wanted = wanted] {
      auto writer = TapeWriter::create(paths, {"device", "driver"}, {.on_existing = OnExisting::overwrite});
      ASSERT_TRUE(writer);
      for (const TapeSink::Sync& sync : writer->syncers()) EXPECT_EQ(sync(), wanted) << error;
      const auto finished = writer->finish(tape_time_us(1));
      EXPECT_EQ(finished.has_value(), wanted == 0);
      if (wanted == EIO) {
        EXPECT_EQ(finished.error(), make_error(Errc::io, "the tape may be incomplete: Input/output error"));
      }
      auto made = NewTape::create(literal_tape(dir / ("n" + std::to_string(error))),
                                  TapeHeader{.device = "device", .driver = "driver"}, {});
      ASSERT_TRUE(made);
      EXPECT_EQ(made->finish(std::nullopt).has_value(), wanted == 0);
    }));
  }
}

TEST_F(RefusedCalls, WithoutARenameThatReplacesNothingASetIsLinked) {
  EXPECT_TRUE(holds_without({no_rename_flags(EINVAL)}, [&] {
    auto set = TapeSet::begin(paths, OnExisting::refuse);
    ASSERT_TRUE(set);
    write_all(*set->place(paths), "new");
    EXPECT_TRUE(set->publish());
  }));
  expect_all(paths, "new");
  EXPECT_EQ(names().size(), 3U);
}

TEST_F(RefusedCalls, WithoutAnExchangeOfFilesASetReplacesThemOneByOne) {
  write_all(paths, "old");
  EXPECT_TRUE(holds_without({no_rename_flags(EINVAL)}, [&] {
    auto set = TapeSet::begin(paths, OnExisting::overwrite);
    ASSERT_TRUE(set);
    write_all(*set->place(paths), "new");
    EXPECT_TRUE(set->publish());
  }));
  expect_all(paths, "new");
  EXPECT_EQ(names().size(), 3U);
}

TEST_F(RefusedCalls, ASetThatCannotBeMovedIsToldWithTheFile) {
  const TapePaths other = literal_tape(dir / "u.log");
  write_all(other, "old");
  for (const TapePaths& tape : {paths, other}) {
    EXPECT_TRUE(holds_without({no_rename_flags(EIO), {SYS_renameat, EIO}}, [&] {
      auto set = TapeSet::begin(tape, OnExisting::overwrite);
      ASSERT_TRUE(set);
      write_all(*set->place(tape), "new");
      EXPECT_EQ(set->publish().error(),
                make_error(Errc::io, "cannot make '" + tape.events.string() + "': Input/output error"));
    }));
  }
  expect_all(other, "old");
  EXPECT_EQ(names().size(), 3U);
}

TEST_F(RefusedCalls, WhereTheFileSystemHasNoLocksATapeIsMadeWithoutOne) {
  for (const int error : {ENOLCK, EINVAL, EOPNOTSUPP, ENOSYS}) {
    EXPECT_TRUE(holds_without({no_command(F_OFD_SETLK, error)}, [&] {
      const auto writer = TapeWriter::create(paths, {"device", "driver"}, {.sync = false});
      ASSERT_TRUE(writer);
      EXPECT_FALSE(is_being_written(paths));
      EXPECT_TRUE(TapeWriter::create(paths, {"device", "driver"}, {.on_existing = OnExisting::overwrite}));
    })) << error;
    for (const fs::path& path : {paths.read, paths.write, paths.events}) fs::remove(path);
  }
}

TEST_F(RefusedCalls, ALockThatFailsIsToldAndLeavesNothing) {
  EXPECT_TRUE(holds_without({no_command(F_OFD_SETLK, EIO)}, [&] {
    EXPECT_EQ(TapeWriter::create(paths, {"device", "driver"}, {}).error(),
              make_error(Errc::io, "cannot make '" + paths.read.string() + "': Input/output error"));
    EXPECT_THAT(names(), IsEmpty());
    write_all(paths, "old");
    EXPECT_EQ(TapeWriter::create(paths, {"device", "driver"}, {.on_existing = OnExisting::overwrite}).error(),
              make_error(Errc::io, "cannot lock '" + paths.read.string() + "': Input/output error"));
  }));
  expect_all(paths, "old");
  EXPECT_EQ(names().size(), 3U);
}

TEST_F(RefusedCalls, WhoDoesNotGetTheLockOfWhatHeHasMadeHasLostIt) {
  for (const int error : {EAGAIN, EACCES}) {
    EXPECT_TRUE(holds_without({no_command(F_OFD_SETLK, error)}, [&] {
      EXPECT_EQ(TapeWriter::create(paths, {"device", "driver"}, {}).error(),
                make_error(Errc::usage, "cannot make the tape: '" + paths.read.string() +
                                            "' has come into being meanwhile; take another name"));
    })) << error;
    EXPECT_THAT(names(), ElementsAre("t.logr")) << "it is somebody else's by now";
    fs::remove(paths.read);
  }
}

TEST_F(RefusedCalls, AFileThatCannotBeLookedAtIsNotLocked) {
  test::write_file(file, {});
  EXPECT_TRUE(holds_without(no_look_at_descriptors(EIO), [&] {
    const UniqueFd fd(::open(file.c_str(), O_WRONLY | O_CLOEXEC));
    EXPECT_EQ(lock_tape_file(fd.get(), AT_FDCWD, file), TapeLock::failed);
    EXPECT_EQ(errno, EIO);
  }));
}

TEST_F(RefusedCalls, WithoutASecondDescriptorNoTapeIsMade) {
  EXPECT_TRUE(holds_without({no_command(F_DUPFD_CLOEXEC, EMFILE)}, [&] {
    EXPECT_EQ(TapeWriter::create(paths, {"device", "driver"}, {}).error(),
              make_error(Errc::io, "cannot make '" + paths.read.string() + "': Too many open files"));
  }));
  EXPECT_THAT(names(), IsEmpty());
}

TEST_F(RefusedCalls, AFileIsNotToBlameForWhatTheSystemLacks) {
  test::write_file(file, test::bytes_of("abc"));
  for (const auto& [error, code] :
       {std::pair(EMFILE, Errc::io), std::pair(ENFILE, Errc::io), std::pair(ENOMEM, Errc::io),
        std::pair(EIO, Errc::io), std::pair(EACCES, Errc::usage), std::pair(ELOOP, Errc::usage)}) {
    EXPECT_TRUE(holds_without({{SYS_openat, error}}, [&, error = error, code = code] {
      EXPECT_EQ(FileSource::open(file).error(),
                make_error(code, "cannot read " + file + ": " + errno_text(error)));
    })) << error;
  }
}

TEST_F(RefusedCalls, AFileThatCannotBeLookedAtHasNoSize) {
  test::write_file(file, test::bytes_of("abc"));
  EXPECT_TRUE(holds_without(no_look_at_descriptors(EIO), [&] {
    EXPECT_EQ(FileSource::open(file).error(),
              make_error(Errc::io, "cannot read " + file + ": Input/output error"));
  }));
  const auto source = FileSource::open(file);
  ASSERT_TRUE(source);
  EXPECT_TRUE(holds_without(no_look_at_descriptors(EIO), [&] {
    EXPECT_EQ((**source).size().error(),
              make_error(Errc::io, "cannot tell the size of " + file + ": Input/output error"));
  }));
  EXPECT_TRUE(holds_without({{SYS_pread64, EIO}}, [&] {
    Bytes into(2);
    EXPECT_EQ((**source).read_at(1, into).error(),
              make_error(Errc::io, "cannot read " + file + " at offset 1: Input/output error"));
  }));
}

TEST_F(RefusedCalls, AHeaderSaysWhatTheSystemTellsAndHasAnIdOfItsOwnAnyway) {
  EXPECT_TRUE(holds_without({{SYS_getrandom, ENOSYS}, {SYS_uname, EFAULT}}, [&] {
    const TapeHeader one = completed(TapeHeader{});
    const TapeHeader other = completed(TapeHeader{});
    EXPECT_THAT(one.id.raw(), MatchesRegex("[0-9a-f]{32}"));
    EXPECT_NE(one.id, other.id);
    EXPECT_EQ(one.host, "");
  }));
  const ManualClock clock;
  EXPECT_TRUE(
      holds_without({{SYS_openat, ENOENT}}, [&] { EXPECT_EQ(tape_zero(clock.now(), clock).boot, ""); }));
  EXPECT_TRUE(holds_without({{SYS_read, EIO}}, [&] { EXPECT_EQ(tape_zero(clock.now(), clock).boot, ""); }));
}

TEST_F(RefusedCalls, AFileOfASetThatMayNotBeOpenedIsTold) {
  const RefusedCall::Argument to_write{2, O_WRONLY | O_NOFOLLOW | O_CREAT, O_WRONLY | O_NOFOLLOW};
  const RefusedCall no_write{SYS_openat, EACCES, to_write};
  EXPECT_TRUE(holds_without({RefusedCall{SYS_openat, EIO, to_write}}, [&] {
    auto set = TapeSet::begin(paths, OnExisting::refuse);
    ASSERT_TRUE(set);
    write_all(*set->place(paths), "new");
    EXPECT_EQ(set->publish().error(),
              make_error(Errc::io, "cannot make '" + paths.events.string() + "': Input/output error"));
  }));
  EXPECT_THAT(names(), IsEmpty());
  write_all(paths, "old");
  EXPECT_TRUE(holds_without({no_write}, [&] {
    auto set = TapeSet::begin(paths, OnExisting::overwrite);
    ASSERT_TRUE(set);
    write_all(*set->place(paths), "newer");
    EXPECT_TRUE(set->publish()) << "the rights to the folder are enough";
  }));
  expect_all(paths, "newer");
  EXPECT_TRUE(holds_without({no_write}, [&] {
    EXPECT_EQ(
        TapeWriter::create(paths, {"device", "driver"}, {.on_existing = OnExisting::overwrite}).error(),
        make_error(Errc::usage, "cannot make the tape: '" + paths.read.string() +
                                    "' cannot be locked to be replaced: Permission denied; remove it or "
                                    "take another name"));
  }));
}

}  // namespace
}  // namespace porttape
