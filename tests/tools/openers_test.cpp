#include "tools/openers.hpp"

#include <fcntl.h>
#include <filesystem>
#include <sys/wait.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

TEST(Openers, AreThoseThatHaveTheFileOpen) {
  const test::TempDir dir;
  const std::string path = std::filesystem::canonical(dir.path()) / "file";
  test::write_file(path, {});
  int ends[2];
  ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
  const UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  const pid_t child = ::fork();
  if (child == 0) {
    char c = 0;
    ::close(ends[1]);
    (void)!::read(ends[0], &c, 1);  // until the test lets go
    ::_exit(0);
  }
  const auto found = openers_of({path, "/nothing"});
  ::close(ends[0]);
  ::close(ends[1]);
  ::waitpid(child, nullptr, 0);
  ASSERT_EQ(found.size(), 1U);
  ASSERT_EQ(found.at(path).size(), 1U);  // not this process
  EXPECT_EQ(found.at(path)[0].pid, child);
  EXPECT_EQ(found.at(path)[0].name, "tools_test");
  EXPECT_TRUE(openers_of({}).empty());
  EXPECT_TRUE(openers_of({path}, dir / "no_proc").empty());
}

}  // namespace
}  // namespace porttape
