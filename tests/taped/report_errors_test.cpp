#include <array>
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <string>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>
#include <vector>

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
  fs::create_symlink("circle", dir / "circle");  // nobody knows what is behind it
  for (const char* const name :
       {"t.logr", "t.logw", "t.loge", "folder/t.logw", "./t.loge", "circle/../t.logr", "none/../t.logr"}) {
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

// Two names of one stream: what each gets would stand in it, one report behind the other.
TEST_F(ReportErrors, TwoNamesOfOneStreamAreOnePlace) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
  const UniqueFd in(ends[0]);
  const UniqueFd out(ends[1]);
  const UniqueFd copy(::fcntl(out.get(), F_DUPFD_CLOEXEC, 3));
  const std::string number = std::to_string(out.get());
  const std::string fifo = dir / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  fs::create_symlink("fifo", dir / "link");
  const auto refused = [](const std::string& report, const std::string& junit) {
    return usage_of(check_reports_apart(report, junit)) ==
           "option 'junit': " + quoted(junit) + " has the report already; name another file";
  };
  EXPECT_TRUE(refused("/dev/fd/" + number, "/proc/self/fd/" + number));
  EXPECT_TRUE(refused("/dev/fd/" + number, "/dev/fd/" + std::to_string(copy.get())));
  EXPECT_TRUE(refused(fifo, dir / "link"));
  EXPECT_TRUE(check_reports_apart("/dev/fd/" + number, "/dev/fd/" + std::to_string(in.get()) + "x"));
  EXPECT_TRUE(check_reports_apart("/dev/fd/" + number, fifo));
  EXPECT_TRUE(check_reports_apart("/dev/fd/" + number, dir / "r"));
}

TEST_F(ReportErrors, StdoutIsOnePlaceByAllItsNames) {
  const UniqueFd before(::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3));
  const UniqueFd file(::open((dir / "out").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  const std::vector<std::string> names{"-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", dir / "out"};
  std::vector<std::string> apart;
  std::fflush(stdout);
  ASSERT_GE(::dup2(file.get(), STDOUT_FILENO), 0);
  for (const std::string& report : names) {
    for (const std::string& junit : names) {
      if (check_reports_apart(report, junit)) apart.push_back(report + " " + junit);
    }
  }
  const bool with_another = check_reports_apart("-", dir / "other").has_value();
  std::fflush(stdout);
  ASSERT_GE(::dup2(before.get(), STDOUT_FILENO), 0);
  EXPECT_EQ(apart, std::vector<std::string>());
  EXPECT_TRUE(with_another);
}

TEST_F(ReportErrors, WhatIsPrintedBesideAReportOfThatFileStaysWhole) {
  const UniqueFd file(::open((dir / "out").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  const std::string number = std::to_string(file.get());
  for (const std::string& name :
       {"/dev/fd/" + number, "/proc/self/fd/" + number, fmt::format("/proc/{}/fd/{}", ::getpid(), number)}) {
    ASSERT_EQ(::ftruncate(file.get(), 0), 0);
    ASSERT_EQ(::lseek(file.get(), 0, SEEK_SET), 0);
    ASSERT_EQ(::write(file.get(), "one\n", 4), 4);
    ASSERT_TRUE(write_report(name, "two\n"));
    ASSERT_EQ(::write(file.get(), "three\n", 6), 6);
    EXPECT_EQ(std::string(as_text(test::read_file(dir / "out"))), "one\ntwo\nthree\n") << name;
  }
  const UniqueFd to_read(::open((dir / "out").c_str(), O_RDONLY | O_CLOEXEC));
  const Result<void> written = write_report("/dev/fd/" + std::to_string(to_read.get()), "x");
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, Errc::io);
}

TEST_F(ReportErrors, TwoHardLinksAreTwoPlaces) {
  test::write_file(dir / "r", {});
  fs::create_hard_link(dir / "r", dir / "hard");
  EXPECT_TRUE(check_reports_apart(dir / "r", dir / "hard"));
  ASSERT_TRUE(write_report(dir / "r", "one"));
  ASSERT_TRUE(write_report(dir / "hard", "two"));
  EXPECT_EQ(test::read_file(dir / "r").size(), 3U);
}

}  // namespace
}  // namespace porttape
