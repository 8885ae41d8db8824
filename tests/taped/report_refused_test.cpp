// What is said of a report that the system does not take, before the run and after it.

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <functional>
#include <string>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/error.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/taped/report_file.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::holds_without;
using test::RefusedCall;

RefusedCall no_file_without_name(int error) {
  return {SYS_openat, error, RefusedCall::Argument{2, O_TMPFILE, O_TMPFILE}};
}
RefusedCall no_open_as_it_is(int error) {
  const std::uint32_t flags = O_APPEND | O_NONBLOCK;
  return {SYS_openat, error, RefusedCall::Argument{2, flags, flags}};
}
RefusedCall no_write_of_one_byte(int error) {
  return {SYS_write, error, RefusedCall::Argument{2, 0xffffffff, 1}};
}
std::vector<RefusedCall> no_access(int error) { return {{SYS_faccessat, error}, {SYS_faccessat2, error}}; }
std::vector<RefusedCall> no_wait(int error) {
  std::vector<RefusedCall> calls{{SYS_ppoll, error}};
#ifdef SYS_poll
  calls.push_back({SYS_poll, error});
#endif
  return calls;
}
std::vector<RefusedCall> no_look_at_the_folder(int error) {
  return {{SYS_fstat, error},
          {SYS_newfstatat, error, RefusedCall::Argument{3, AT_EMPTY_PATH, AT_EMPTY_PATH}}};
}

class ReportRefused : public testing::Test {
 protected:
  ReportRefused() { test::write_file(path, as_bytes("old")); }
  static Error error_of(const Result<void>& result) {
    EXPECT_FALSE(result);
    return result ? Error{} : result.error();
  }
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& each : fs::directory_iterator(dir.path())) all.push_back(each.path().filename());
    return all;
  }
  [[nodiscard]] std::string content(const std::string& name) const {
    return std::string(as_text(test::read_file(dir / name)));
  }
  // What comes of a page that goes to stdout, which is `out` meanwhile.
  static Result<void> write_to_stdout(int out, const std::string& text) {
    const UniqueFd before(::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3));
    std::fflush(stdout);
    EXPECT_GE(::dup2(out, STDOUT_FILENO), 0);
    errno = EINTR;  // of something before
    Result<void> written = write_report("-", text, "page");
    EXPECT_GE(::dup2(before.get(), STDOUT_FILENO), 0);
    return written;
  }

  test::TempDir dir;
  const std::string path = dir / "report";
};

TEST_F(ReportRefused, WhateverFailsIsTheProgramsErrorAndTheOldReportStays) {
  struct Row {
    RefusedCall call;
    std::string what;
  };
  const std::string written = " cannot be written: ";
  for (const int error : {EIO, ENOSPC, EDQUOT, EROFS, EACCES}) {
    const std::string why = errno_text(error);
    const std::vector<Row> rows{
        {no_file_without_name(error), " cannot be made: " + why + "; name another"},
        {{SYS_write, error, RefusedCall::Argument{2, 0xffffffff, 6}}, written + why},
        {{SYS_fsync, error}, written + why},
        {{SYS_fchmod, error}, written + why},
        {{SYS_linkat, error}, written + why},
        {{SYS_renameat, error}, written + why},
    };
    for (const Row& row : rows) {
      EXPECT_TRUE(holds_without({row.call}, [&] {
        EXPECT_EQ(error_of(write_report(path, "newer\n", "page", 0060)),
                  make_error(Errc::io, "page '" + path + "'" + row.what));
      })) << row.call.number;
      EXPECT_EQ(content("report"), "old");
      EXPECT_EQ(names(), std::vector<std::string>{"report"});
    }
  }
}

TEST_F(ReportRefused, APlaceThatCannotBeLookedAtIsToldBeforeTheRunAndAfterIt) {
  for (const int error : {EIO, EACCES, ENOMEM}) {
    const RefusedCall::Argument not_followed{3, AT_EMPTY_PATH | AT_SYMLINK_NOFOLLOW, AT_SYMLINK_NOFOLLOW};
    const std::vector<RefusedCall> no_look{{SYS_newfstatat, error, not_followed}};
    for (const std::vector<RefusedCall>& calls : {no_look, no_look_at_the_folder(error)}) {
      EXPECT_TRUE(holds_without(calls, [&] {
        const Error before = error_of(check_report_place(path, "page"));
        EXPECT_EQ(before.code, Errc::usage);
        EXPECT_TRUE(before.message.starts_with("page '" + path + "': ")) << before.message;
        EXPECT_TRUE(before.message.ends_with(errno_text(error))) << before.message;
        const Error after = error_of(write_report(path, "new", "page"));
        EXPECT_EQ(after.code, Errc::io);
        EXPECT_TRUE(after.message.starts_with("page '" + path + "' cannot be written: ")) << after.message;
        EXPECT_TRUE(after.message.ends_with(errno_text(error))) << after.message;
      }));
      EXPECT_EQ(content("report"), "old");
    }
  }
}

TEST_F(ReportRefused, ALinkThatCannotBeReadIsToldBeforeTheRunAndAfterIt) {
  fs::create_symlink("report", dir / "link");
  const std::string link = "page '" + (dir / "link") + "'";
  for (const int error : {EIO, EACCES, ENOMEM}) {
    EXPECT_TRUE(holds_without({{SYS_readlinkat, error}}, [&] {
      EXPECT_EQ(error_of(check_report_place(dir / "link", "page")),
                make_error(Errc::usage, link + ": " + errno_text(error)));
      EXPECT_EQ(error_of(write_report(dir / "link", "new", "page")),
                make_error(Errc::io, link + " cannot be written: " + errno_text(error)));
    }));
    EXPECT_EQ(content("report"), "old");
  }
}

TEST_F(ReportRefused, ALinkOfOnesOwnToAnothersFileIsRefusedBeforeTheRunAndAfterIt) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can make a file of another user";
  ASSERT_EQ(::chown(path.c_str(), 65534, 65534), 0);
  fs::create_symlink("report", dir / "link");
  const std::string link = "page '" + (dir / "link") + "'";
  const std::string why =
      "the link leads to '" + path + "', which is another user's; name a file of your own";
  EXPECT_EQ(error_of(check_report_place(dir / "link", "page")), make_error(Errc::usage, link + ": " + why));
  EXPECT_EQ(error_of(write_report(dir / "link", "new", "page")),
            make_error(Errc::io, link + " cannot be written: " + why));
  EXPECT_EQ(content("report"), "old");
  EXPECT_TRUE(check_report_place(path)) << "who names it himself means it";
}

TEST_F(ReportRefused, WhatIsWrittenToAsItIsSaysWhy) {
  struct Row {
    std::vector<RefusedCall> calls;
    std::string why;
  };
  const std::string nobody = "nobody reads what it leads to";
  std::vector<Row> rows{{{no_open_as_it_is(ENXIO)}, nobody}, {{no_write_of_one_byte(EAGAIN)}, nobody}};
  for (const int error : {EIO, EACCES, ENOMEM}) {
    rows.push_back({{no_open_as_it_is(error)}, errno_text(error)});
    rows.push_back({no_wait(error), errno_text(error)});
    rows.push_back({{no_write_of_one_byte(error)}, errno_text(error)});
    rows.push_back({{{SYS_close, error}}, errno_text(error)});
  }
  for (const Row& row : rows) {
    EXPECT_TRUE(holds_without(row.calls, [&] {
      EXPECT_EQ(error_of(write_report("/dev/null", "x", "page")),
                make_error(Errc::io, "page '/dev/null' cannot be written: " + row.why));
    })) << row.calls.front().number;
  }
}

TEST_F(ReportRefused, WithoutUnnamedFilesThePlaceIsGoodWhereItsFolderMayBeWrittenTo) {
  for (const int unknown : {EOPNOTSUPP, EISDIR, EINVAL}) {
    EXPECT_TRUE(holds_without({no_file_without_name(unknown)}, [&] {
      EXPECT_TRUE(check_report_place(path));
      EXPECT_TRUE(check_report_place(dir / "other"));
    }));
    for (const int error : {EACCES, EROFS}) {
      std::vector<RefusedCall> calls = no_access(error);
      calls.push_back(no_file_without_name(unknown));
      EXPECT_TRUE(holds_without(calls, [&] {
        EXPECT_EQ(error_of(check_report_place(path, "page")),
                  make_error(Errc::usage, "page '" + path + "' cannot be written: " + errno_text(error) +
                                              "; name another file"));
      }));
    }
  }
  EXPECT_EQ(names(), std::vector<std::string>{"report"});
}

TEST_F(ReportRefused, WhatTheSystemSaysOfThePlaceIsToldBeforeTheRun) {
  const auto why = [](const std::string& name, int error) {
    return make_error(Errc::usage,
                      "page '" + name + "' cannot be written: " + errno_text(error) + "; name another file");
  };
  for (const int error : {EACCES, EROFS, EIO}) {
    EXPECT_TRUE(holds_without(no_access(error), [&] {
      EXPECT_TRUE(check_report_place(path)) << "a file without a name is the surer probe";
      EXPECT_EQ(error_of(check_report_place("/dev/null", "page")), why("/dev/null", error));
    }));
    EXPECT_TRUE(holds_without({no_file_without_name(error)}, [&] {
      EXPECT_EQ(error_of(check_report_place(path, "page")), why(path, error));
    }));
  }
}

// Of another user than the one whose folder it is.
TEST_F(ReportRefused, InASharedFolderAnotherUsersFileIsFoundBeforeTheRun) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can become another user";
  constexpr uid_t user = 65534;
  struct Row {
    mode_t folder;
    bool own_folder;
    bool own_file;
    int error;
  };
  ASSERT_EQ(::chmod(dir.path().c_str(), 0755), 0);
  const std::string folder = dir / "shared";
  fs::create_directory(folder);
  test::write_file(folder + "/report", as_bytes("old"));
  for (const Row& row : std::vector<Row>{{01777, false, false, EPERM},
                                         {01777, false, true, 0},
                                         {01777, true, false, 0},
                                         {0777, false, false, 0},
                                         {0755, false, true, EACCES}}) {
    ASSERT_EQ(::chown(folder.c_str(), row.own_folder ? user : 0, 0), 0);
    ASSERT_EQ(::chmod(folder.c_str(), row.folder), 0);
    ASSERT_EQ(::chown((folder + "/report").c_str(), row.own_file ? user : 0, 0), 0);
    EXPECT_TRUE(check_report_place(folder + "/report")) << "root may do it";
    const auto as_user = [&](const std::vector<RefusedCall>& calls) {
      return holds_without(calls, [&] {
        ASSERT_EQ(::setresuid(user, user, user), 0);
        const Result<void> place = check_report_place(folder + "/report");
        const std::string why = row.error == 0 ? "" : errno_text(row.error);
        EXPECT_EQ(place ? "" : place.error().message,
                  why.empty()
                      ? ""
                      : "report '" + folder + "/report' cannot be written: " + why + "; name another file");
        EXPECT_EQ(check_report_place(folder + "/none").has_value(), row.folder != 0755);
      });
    };
    EXPECT_TRUE(as_user({})) << row.folder;
    EXPECT_TRUE(as_user({no_file_without_name(EOPNOTSUPP)})) << row.folder;
  }
}

TEST_F(ReportRefused, StdoutGetsItsReportOrWhyItDoesNot) {
  const UniqueFd file(::open(path.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC));
  EXPECT_TRUE(write_to_stdout(file.get(), "a report\n"));
  EXPECT_TRUE(write_to_stdout(file.get(), ""));
  EXPECT_EQ(content("report"), "a report\n");
  const UniqueFd full(::open("/dev/full", O_WRONLY | O_CLOEXEC));
  ASSERT_TRUE(full);
  EXPECT_EQ(error_of(write_to_stdout(full.get(), "x")),
            make_error(Errc::io, "page '-' cannot be written: No space left on device"));
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
  const UniqueFd reader(ends[0]);
  const UniqueFd writer(ends[1]);
  EXPECT_EQ(error_of(write_to_stdout(writer.get(), std::string(std::size_t{1} << 20U, 'x'))),
            make_error(Errc::io, "page '-' cannot be written: nobody reads what it leads to"));
}

}  // namespace
}  // namespace porttape
