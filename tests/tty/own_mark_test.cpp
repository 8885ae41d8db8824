#include "libport/tty/own_mark.hpp"

#include <ctime>
#include <fcntl.h>
#include <filesystem>
#include <sys/stat.h>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

struct stat marked(const std::string& path, timespec time) {
  mark_as_own(AT_FDCWD, path, time);
  struct stat status {};
  EXPECT_EQ(::lstat(path.c_str(), &status), 0);
  return status;
}

TEST(OwnMark, IsTheNextTimeWithItsNanoseconds) {
  const test::TempDir dir;
  const std::string file = dir / "file";
  test::write_file(file, {});
  struct Case {
    timespec time;
    timespec mark;
  };
  for (const Case& each :
       {Case{{7, 0}, {7, 545'450}}, Case{{7, 545'449}, {7, 545'450}}, Case{{7, 545'450}, {7, 545'450}},
        Case{{7, 545'451}, {7, 1'545'450}}, Case{{7, 999'545'450}, {7, 999'545'450}},
        Case{{7, 999'545'451}, {8, 545'450}}, Case{{7, 999'999'999}, {8, 545'450}}}) {
    const struct stat status = marked(file, each.time);
    EXPECT_EQ(status.st_mtim.tv_sec, each.mark.tv_sec) << each.time.tv_nsec;
    EXPECT_EQ(status.st_mtim.tv_nsec, each.mark.tv_nsec) << each.time.tv_nsec;
    EXPECT_TRUE(is_marked_as_own(status));
  }
}

TEST(OwnMark, ANanosecondBesideItIsNone) {
  struct stat status {};
  EXPECT_FALSE(is_marked_as_own(status));
  for (const long ns : {545'449L, 545'451L, 1'545'449L}) {
    status.st_mtim.tv_nsec = ns;
    EXPECT_FALSE(is_marked_as_own(status)) << ns;
  }
}

TEST(OwnMark, IsOnALinkAndNotOnWhatItPointsTo) {
  const test::TempDir dir;
  const std::string file = dir / "file";
  const std::string link = dir / "link";
  test::write_file(file, {});
  std::filesystem::create_symlink(file, link);
  EXPECT_EQ(marked(link, {1000, 0}).st_mtim.tv_sec, 1000);
  struct stat status {};
  ASSERT_EQ(::stat(file.c_str(), &status), 0);
  EXPECT_NE(status.st_mtim.tv_sec, 1000);
}

}  // namespace
}  // namespace porttape
