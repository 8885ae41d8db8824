#include "libport/port/report_file.hpp"

#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace porttape
