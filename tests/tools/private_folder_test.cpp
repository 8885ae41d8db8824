#include "tools/private_folder.hpp"

#include <cstdlib>
#include <filesystem>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "tests/support/next_call.hpp"
#include "tests/support/temp_dir.hpp"

namespace {

int sent_at_mkdirat = 0;  // a signal; 0: none

}  // namespace

// The C library's, after which a signal comes at once.
extern "C" int mkdirat(int folder, const char* name, mode_t mode) noexcept {
  static const auto real = porttape::next_call<int (*)(int, const char*, mode_t)>("mkdirat");
  const int made = real(folder, name, mode);
  if (made == 0 && sent_at_mkdirat != 0) (void)::raise(sent_at_mkdirat);
  return made;
}

namespace porttape {
namespace {

TEST(PrivateFolderTest, ASignalThatComesWhileItIsMadeLeavesNone) {
  const test::TempDir dir;
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    const pid_t child = ::fork();
    if (child == 0) {
      for (const int each : {SIGINT, SIGTERM, SIGHUP}) ::signal(each, SIG_DFL);
      ::setenv("TMPDIR", dir.path().c_str(), 1);
      sent_at_mkdirat = number;
      PrivateFolder folder;
      (void)folder.make();
      ::_exit(0);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == number) << status;
    EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  }
}

}  // namespace
}  // namespace porttape
