#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <string>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/tape/tape_writer.hpp"
#include "libport/taped/report_file.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class ReportErrors : public testing::Test {
 protected:
  static std::string usage_of(const Result<void>& result) { return text_of(result, Errc::usage); }
  static std::string io_of(const Result<void>& result) { return text_of(result, Errc::io); }
  static std::string text_of(const Result<void>& result, Errc code) {
    EXPECT_FALSE(result);
    if (result) return {};
    EXPECT_EQ(result.error().code, code);
    return result.error().message;
  }
  static std::string quoted(const std::string& path) { return "'" + path + "'"; }

  test::TempDir dir;
};

TEST_F(ReportErrors, AFolderIsNoPlace) {
  const std::string folder = dir.path().string();
  EXPECT_EQ(usage_of(check_report_place(folder)), "report " + quoted(folder) + " is a folder; name a file");
  EXPECT_EQ(usage_of(check_report_place(folder, "page")),
            "page " + quoted(folder) + " is a folder; name a file");
}

TEST_F(ReportErrors, AMissingFolderIsNamedWithHowToMakeIt) {
  const std::string path = dir / "no/report.json";
  EXPECT_EQ(usage_of(check_report_place(path, "page")),
            "page " + quoted(path) + ": its folder does not exist; type mkdir -p " + (dir / "no"));
  EXPECT_EQ(io_of(write_report(path, "x", "page")).substr(0, 5), "page ");
}

TEST_F(ReportErrors, WhatTheSystemSaysIsInTheMessage) {
  const std::string path = dir / "circle";
  fs::create_symlink("circle", path);
  const std::string why = "Too many levels of symbolic links";
  EXPECT_EQ(usage_of(check_report_place(path)), "report " + quoted(path) + ": " + why);
  EXPECT_EQ(io_of(write_report(path, "x")), "report " + quoted(path) + " cannot be written: " + why);
  EXPECT_EQ(io_of(write_report("/dev/full", "x", "page")),
            "page '/dev/full' cannot be written: No space left on device");
}

TEST_F(ReportErrors, AFolderInWhichNoFileCanBeMadeIsFoundBeforeTheRun) {
  const std::string path = dir / "report.json";
  const test::RefusedCall no_files{SYS_openat, EROFS, test::RefusedCall::Argument{2, O_TMPFILE, O_TMPFILE}};
  EXPECT_TRUE(test::holds_without({no_files}, [&] {
    EXPECT_EQ(usage_of(check_report_place(path)),
              "report " + quoted(path) + " cannot be written: Read-only file system; name another file");
  }));
}

TEST_F(ReportErrors, ADeviceThatTakesNothingIsAnError) {
  const test::RefusedCall nothing{SYS_write, 0, test::RefusedCall::Argument{2, 0xffffffff, 1}};
  EXPECT_TRUE(test::holds_without({nothing}, [&] {
    EXPECT_EQ(io_of(write_report("/dev/null", "x")),
              "report '/dev/null' cannot be written: Input/output error");
  }));
}

TEST_F(ReportErrors, AChainOfLinksMayBeAsLongAsTheKernelFollows) {
  test::write_file(dir / "0", as_bytes("old"));
  for (int link = 1; link <= 41; ++link)
    fs::create_symlink(std::to_string(link - 1), dir / std::to_string(link));
  EXPECT_TRUE(write_report(dir / "40", "new"));
  EXPECT_EQ(as_text(test::read_file(dir / "0")), "new");
  EXPECT_FALSE(write_report(dir / "41", "newer"));
  EXPECT_EQ(as_text(test::read_file(dir / "0")), "new");
}

TEST_F(ReportErrors, APipeWithoutAReaderIsSaidToHaveNone) {
  const std::string pipe = dir / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  errno = EIO;  // of something before
  EXPECT_TRUE(check_report_place(pipe));
  EXPECT_EQ(io_of(write_report(pipe, "x")),
            "report " + quoted(pipe) + " cannot be written: nobody reads what it leads to");
}

TEST_F(ReportErrors, MoreThanAPipeHoldsArrivesWhole) {
  int ends[2];
  ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
  const UniqueFd out(ends[0]);
  UniqueFd in(ends[1]);
  std::string text;
  while (text.size() < 300'000) text += std::to_string(text.size()) + " ";
  std::string got(text.size(), '\0');
  std::thread reader([&] {
    for (std::size_t at = 0; at < got.size();) {
      const ssize_t n = ::read(out.get(), got.data() + at, got.size() - at);
      if (n <= 0) return;
      at += static_cast<std::size_t>(n);
    }
  });
  const Result<void> written = write_report("/dev/fd/" + std::to_string(in.get()), text);
  if (!written) in.reset();  // so that the reader ends
  reader.join();
  EXPECT_TRUE(written);
  EXPECT_TRUE(got == text);
}

TEST_F(ReportErrors, WhatIsReadAndWhatIsThereAreNamed) {
  const std::string rules = dir / "my.rules";
  const std::string link = dir / "link";
  test::write_file(rules, as_bytes("x"));
  fs::create_symlink(rules, link);
  EXPECT_EQ(usage_of(check_report_free(link, true, rules)),
            "report " + quoted(link) + " is " + quoted(rules) + ", which is read; name another file");
  EXPECT_EQ(usage_of(check_report_free(rules, false, dir / "other")),
            "report " + quoted(rules) + " exists already; name another, or --overwrite");
}

TEST_F(ReportErrors, ATapeThatIsBeingWrittenIsNotReplaced) {
  const TapePaths tape = literal_tape(dir / "t.log");
  Result<TapeWriter> writer = TapeWriter::create(tape, {.device = "memory", .driver = "test"}, {});
  ASSERT_TRUE(writer);
  EXPECT_FALSE(check_report_free(tape.events, true, dir / "other"));
  ASSERT_TRUE(writer->finish(TapeTime{}));
  EXPECT_TRUE(check_report_free(tape.events, true, dir / "other"));
}

TEST_F(ReportErrors, AReportIsApartFromTheTapeWhateverNameLeadsThere) {
  const TapePaths tape = literal_tape(dir / "t.log");
  fs::create_directory_symlink(dir.path(), dir / "folder");
  EXPECT_TRUE(check_report_apart("", tape));
  EXPECT_TRUE(check_report_apart("-", tape));
  EXPECT_TRUE(check_report_apart(dir / "t.log", tape));
  EXPECT_TRUE(check_report_apart(dir / "report.json", tape));
  for (const char* const name : {"t.logr", "t.logw", "t.loge", "folder/t.logw", "./t.loge"}) {
    const std::string path = dir / name;
    EXPECT_EQ(usage_of(check_report_apart(path, tape)),
              "report " + quoted(path) + " is a file of the tape; name another file");
  }
}

TEST_F(ReportErrors, TheTwoReportsOfARunGoToTwoPlaces) {
  fs::create_directory_symlink(dir.path(), dir / "folder");
  EXPECT_TRUE(check_reports_apart("", ""));
  EXPECT_TRUE(check_reports_apart("-", ""));
  EXPECT_TRUE(check_reports_apart("-", dir / "r"));
  EXPECT_TRUE(check_reports_apart(dir / "r", dir / "r.xml"));
  EXPECT_TRUE(check_reports_apart("/dev/null", "/dev/null"));
  EXPECT_EQ(usage_of(check_reports_apart("-", "-")),
            "option 'junit': '-' has the report already; name another file");
  for (const char* const name : {"r", "./r", "folder/r"}) {
    const std::string path = dir / name;
    EXPECT_EQ(usage_of(check_reports_apart(dir / "r", path)),
              "option 'junit': " + quoted(path) + " has the report already; name another file");
  }
}

}  // namespace
}  // namespace porttape
