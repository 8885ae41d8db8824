#include "libport/taped/report_file.hpp"

#include <cstddef>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

std::string content(const fs::path& path) {
  std::ostringstream out;
  out << std::ifstream(path).rdbuf();
  return out.str();
}

TEST(ReportFile, IsReplacedWhole) {
  const test::TempDir dir;
  const fs::path path = dir.path() / "report.json";
  ASSERT_TRUE(write_report(path.string(), "a long first report\n").has_value());
  ASSERT_TRUE(write_report(path.string(), "second\n").has_value());
  EXPECT_EQ(content(path), "second\n");
  EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 1);
}

TEST(ReportFile, AMissingFolderIsFoundBeforeTheRun) {
  const test::TempDir dir;
  EXPECT_FALSE(check_report_place((dir.path() / "no" / "report.json").string()).has_value());
  EXPECT_FALSE(check_report_place(dir.path().string()).has_value());
  EXPECT_TRUE(check_report_place((dir.path() / "report.json").string()).has_value());
}

TEST(ReportFile, AFailedWriteLeavesTheOldReport) {
  const test::TempDir dir;
  EXPECT_FALSE(write_report((dir.path() / "no" / "report.json").string(), "x").has_value());
}

TEST(ReportFile, ReplacesAFileOnlyWhereItMayAndNeverWhatIsRead) {
  const test::TempDir dir;
  const std::string report = dir / "report.json";
  const std::string rules = dir / "my.rules";
  std::ofstream(rules) << "secret\n";
  EXPECT_TRUE(check_report_free(report, false, rules));
  EXPECT_TRUE(check_report_free("-", false, rules));
  EXPECT_TRUE(check_report_free("/dev/null", false, rules));
  std::ofstream(report) << "old\n";
  const auto taken = check_report_free(report, false, rules);
  ASSERT_FALSE(taken);
  EXPECT_NE(taken.error().message.find("exists already; name another, or --overwrite"), std::string::npos);
  EXPECT_TRUE(check_report_free(report, true, rules));
  fs::create_symlink(rules, dir / "link");
  for (const std::string& name : {rules, dir / "link"}) {
    const auto same = check_report_free(name, true, rules);
    ASSERT_FALSE(same);
    EXPECT_NE(same.error().message.find("which is read"), std::string::npos);
  }
}

class ReportFileLinks : public testing::Test {
 protected:
  ReportFileLinks() { std::ofstream(victim) << "precious\n"; }

  const test::TempDir dir;
  const std::string report = dir / "report.json";
  const std::string victim = dir / "victim";
};

TEST_F(ReportFileLinks, AHardLinkToAnotherFileIsReplacedNotWrittenThrough) {
  fs::create_hard_link(victim, report);
  ASSERT_TRUE(write_report(report, "new\n").has_value());
  EXPECT_EQ(content(victim), "precious\n");
  EXPECT_EQ(content(report), "new\n");
}

// A name made of the process id can be planted beforehand.
TEST_F(ReportFileLinks, LinksPlantedAtTheTemporaryNameAreNotFollowed) {
  fs::create_symlink(victim, report + "." + std::to_string(::getpid()) + ".new");
  ASSERT_TRUE(write_report(report, "new\n").has_value());
  EXPECT_EQ(content(victim), "precious\n");
  EXPECT_EQ(content(report), "new\n");
}

TEST_F(ReportFileLinks, TheUsersOwnLinkIsKeptAndItsTargetReplaced) {
  fs::create_symlink("victim", report);
  ASSERT_TRUE(write_report(report, "new\n").has_value());
  EXPECT_TRUE(fs::is_symlink(report));
  EXPECT_EQ(content(victim), "new\n");
}

TEST_F(ReportFileLinks, AnotherUsersLinkIsRefusedBeforeTheRunAndAfterIt) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can make a link of another user";
  fs::create_symlink(victim, report);
  ASSERT_EQ(::lchown(report.c_str(), 65534, 65534), 0);
  EXPECT_FALSE(check_report_place(report).has_value());
  EXPECT_FALSE(write_report(report, "new\n").has_value());
  EXPECT_EQ(content(victim), "precious\n");
}

TEST_F(ReportFileLinks, AFolderMayBeReachedByTheUsersOwnLink) {
  fs::create_directory(dir / "folder");
  fs::create_symlink("folder", dir / "link");
  EXPECT_TRUE(check_report_place(dir / "link/report.json").has_value());
  ASSERT_TRUE(write_report(dir / "link/report.json", "new\n").has_value());
  EXPECT_EQ(content(dir / "folder/report.json"), "new\n");
}

TEST_F(ReportFileLinks, AnotherUsersLinkToAFolderIsRefusedBeforeTheRunAndAfterIt) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can make a link of another user";
  const std::string link = dir / "link";
  fs::create_directories(dir / "folder/deep");
  fs::create_symlink("folder", link);
  const std::string there = link + "/deep/report.json";
  EXPECT_TRUE(check_report_place(there).has_value());
  ASSERT_EQ(::lchown(link.c_str(), 65534, 65534), 0);
  const std::string why = "'link' on the way there is a link that another user made; name the folder itself";
  const Result<void> place = check_report_place(there);
  ASSERT_FALSE(place.has_value());
  EXPECT_EQ(place.error().message, "report '" + there + "': " + why);
  const Result<void> written = write_report(there, "new\n");
  ASSERT_FALSE(written.has_value());
  EXPECT_EQ(written.error().message, "report '" + there + "' cannot be written: " + why);
  // A link of the user's own that leads through it, too.
  fs::create_symlink(there, report);
  EXPECT_FALSE(write_report(report, "new\n").has_value());
  EXPECT_TRUE(fs::is_empty(dir / "folder/deep"));
}

TEST_F(ReportFileLinks, ALinkInACircleIsAnError) {
  fs::create_symlink("report.json", report);
  EXPECT_FALSE(check_report_place(report).has_value());
}

TEST(ReportFile, IsReadableByAllAsTheUmaskAllows) {
  const test::TempDir dir;
  const mode_t mask = ::umask(027);
  const Result<void> written = write_report(dir / "r", "x");
  ::umask(mask);
  ASSERT_TRUE(written.has_value());
  EXPECT_EQ(fs::status(dir / "r").permissions(), fs::perms(0640));
}

TEST(ReportFile, APlaceThatCannotBeWrittenIsFoundBeforeTheRun) {
  const Result<void> place = check_report_place("/proc/report.json");
  ASSERT_FALSE(place.has_value());
  EXPECT_EQ(place.error().code, Errc::usage);
}

TEST(ReportFile, APipeThatNobodyOpenedIsAnErrorAndNoWait) {
  const test::TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "pipe").c_str(), 0600), 0);
  EXPECT_TRUE(check_report_place(dir / "pipe").has_value());
  EXPECT_FALSE(write_report(dir / "pipe", "x").has_value());
}

TEST(ReportFile, APipeThatNobodyEmptiesIsAnErrorAndNoWait) {
  const test::TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "pipe").c_str(), 0600), 0);
  const UniqueFd reader(::open((dir / "pipe").c_str(), O_RDONLY | O_NONBLOCK));
  ASSERT_TRUE(reader);
  const Result<void> written = write_report(dir / "pipe", std::string(std::size_t{1} << 20U, 'x'));
  ASSERT_FALSE(written.has_value());
  EXPECT_NE(written.error().message.find("nobody reads what it leads to"), std::string::npos)
      << written.error().message;
}

TEST(ReportFile, AnOpenFileGivenByItsDescriptorIsWrittenTo) {
  const test::TempDir dir;
  std::ofstream(dir / "log") << "before\n";
  const UniqueFd log(::open((dir / "log").c_str(), O_WRONLY | O_APPEND));
  const std::string number = std::to_string(log.get());
  EXPECT_TRUE(check_report_place("/dev/fd/" + number).has_value());
  ASSERT_TRUE(write_report("/dev/fd/" + number, "report\n").has_value());
  ASSERT_TRUE(write_report("/proc/self/fd/" + number, "again\n").has_value());
  fs::create_symlink("/proc/self/fd/" + number, dir / "link");
  ASSERT_TRUE(write_report(dir / "link", "by a link\n").has_value());
  EXPECT_EQ(content(dir / "log"), "before\nreport\nagain\nby a link\n");
  EXPECT_TRUE(check_report_place("/dev/stdout").has_value());
}

}  // namespace
}  // namespace porttape
