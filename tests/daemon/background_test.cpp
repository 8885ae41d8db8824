#include "daemon/background.hpp"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/printable.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

// What the caller's process gets from start(), where the child does `work`.
int status_of(const std::function<void(Background&)>& work) {
  std::fflush(nullptr);
  const pid_t caller = ::fork();
  if (caller == 0) {
    Background background;
    const Result<std::optional<int>> started = background.start();
    if (!started) ::_exit(99);
    if (*started) ::_exit(**started);
    work(background);
    ::_exit(98);
  }
  int status = 0;
  EXPECT_EQ(::waitpid(caller, &status, 0), caller);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(BackgroundTest, TheCallerGetsZeroOnceTheChildIsReadyAndElseItsStatus) {
  const test::TempDir dir;
  const std::string after = dir / "after";
  const std::string session = dir / "session";
  ASSERT_EQ(::mkfifo(after.c_str(), 0600), 0);
  EXPECT_EQ(status_of([&](Background& background) {
              std::ofstream(session) << (::getsid(0) == ::getpid() ? "own" : "the caller's");
              background.ready();
              background.ready();  // nothing to do
              // It goes on, without the caller's terminal.
              struct stat out {};
              struct stat null {};
              const bool gave_up = ::fstat(STDOUT_FILENO, &out) == 0 && ::stat("/dev/null", &null) == 0 &&
                                   out.st_rdev == null.st_rdev;
              std::ofstream(after) << (gave_up ? "gave up" : "kept");
              ::_exit(7);
            }),
            0);
  std::string told;
  std::getline(std::ifstream(after), told);
  EXPECT_EQ(told, "gave up");
  std::getline(std::ifstream(session), told);
  EXPECT_EQ(told, "own");
  EXPECT_EQ(status_of([](Background&) { ::_exit(6); }), 6);
  EXPECT_EQ(status_of([](Background&) { (void)::raise(SIGKILL); }), exit_status::kRuntime);
}

TEST(BackgroundTest, ReadyIsNothingWhereItWasNotStarted) {
  struct stat before {};
  struct stat after {};
  ASSERT_EQ(::fstat(STDERR_FILENO, &before), 0);
  Background background;
  background.ready();
  ASSERT_EQ(::fstat(STDERR_FILENO, &after), 0);
  EXPECT_EQ(before.st_ino, after.st_ino);
}

TEST(BackgroundTest, WithoutDescriptorsOrProcessesItIsAnError) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();  // which make pipes themselves
  for (const auto& [call, error] :
       {std::pair(SYS_pipe2, EMFILE), std::pair(SYS_clone, EAGAIN), std::pair(SYS_clone, ENOMEM)}) {
    EXPECT_TRUE(test::holds_without({{call, error}, {SYS_clone3, error}}, [error = error] {
      Background background;
      const Result<std::optional<int>> started = background.start();
      ASSERT_FALSE(started);
      EXPECT_EQ(started.error().code, Errc::io);
      EXPECT_EQ(started.error().message, "going into the background: " + errno_text(error));
    }));
  }
}

TEST(PidFile, HasOurNumberUntilItGoes) {
  const test::TempDir dir;
  const std::string path = dir / "pid";
  {
    PidFile file;
    ASSERT_TRUE(file.write(path).has_value());
    long number = 0;
    std::ifstream(path) >> number;
    EXPECT_EQ(number, ::getpid());
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(PidFile, OfALivingProcessIsLeftAlone) {
  const test::TempDir dir;
  const std::string path = dir / "pid";
  PidFile living;
  ASSERT_TRUE(living.write(path).has_value());
  {
    PidFile file;
    const Result<void> written = file.write(path);
    ASSERT_FALSE(written.has_value());
    EXPECT_EQ(written.error().code, Errc::usage);
  }
  EXPECT_TRUE(std::filesystem::exists(path));
}

TEST(PidFile, OfAnotherProcessIsNotRemovedAtTheEnd) {
  const test::TempDir dir;
  const std::string path = dir / "pid";
  {
    PidFile file;
    ASSERT_TRUE(file.write(path).has_value());
    std::filesystem::remove(path);
    std::ofstream(path) << "4711\n";
  }
  ASSERT_TRUE(std::filesystem::exists(path));
  long number = 0;
  std::ifstream(path) >> number;
  EXPECT_EQ(number, 4711);
}

TEST(PidFile, AnythingElseIsLeftAlone) {
  const test::TempDir dir;
  const std::string path = dir / "notes";
  std::ofstream(path) << "precious\n";
  {
    PidFile file;
    EXPECT_FALSE(file.write(path).has_value());
  }
  EXPECT_EQ(std::filesystem::file_size(path), 9U);
}

class PidFileThatOthersMayChange : public testing::Test {
 protected:
  PidFileThatOthersMayChange() { std::ofstream(path) << "4711\n"; }
  void expect_refused(const std::string& why) const {
    PidFile file;
    const Result<void> written = file.write(path);
    ASSERT_FALSE(written.has_value());
    EXPECT_EQ(written.error().code, Errc::usage);
    EXPECT_THAT(written.error().message, testing::HasSubstr(why + " and is left alone; name another file"));
    EXPECT_EQ(std::filesystem::file_size(path), 5U);
  }
  test::TempDir dir;
  const std::string path = dir / "pid";
};

TEST_F(PidFileThatOthersMayChange, IsLeftAloneWhereItIsAnotherUsers) {
  if (::chown(path.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "only root can make a file of another user";
  expect_refused("is another user's");
}

TEST_F(PidFileThatOthersMayChange, IsLeftAloneWhereItsGroupOrAllMayWriteIt) {
  for (const mode_t mode : {mode_t{0664}, mode_t{0646}}) {
    ASSERT_EQ(::chmod(path.c_str(), mode), 0);
    expect_refused("can be written by other users");
  }
}

TEST_F(PidFileThatOthersMayChange, IsLeftAloneWhereItHasAnotherName) {
  std::filesystem::create_hard_link(path, dir / "other");
  expect_refused("has other names too");
}

TEST(PidFile, IsNotMadeBehindAnotherUsersLink) {
  const test::TempDir dir;
  const std::string link = dir / "link";
  std::filesystem::create_directory(dir / "folder");
  std::filesystem::create_symlink("folder", link);
  {
    PidFile own;
    ASSERT_TRUE(own.write(link + "/pid").has_value());
    EXPECT_TRUE(std::filesystem::exists(dir / "folder/pid"));
  }
  EXPECT_FALSE(std::filesystem::exists(dir / "folder/pid"));
  if (::lchown(link.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "only root can make a link of another user";
  PidFile file;
  const Result<void> written = file.write(link + "/pid");
  ASSERT_FALSE(written.has_value());
  EXPECT_EQ(written.error().code, Errc::usage);
  EXPECT_THAT(
      written.error().message,
      testing::HasSubstr("pidfile '" + link + "/pid': 'link' on the way there is a link that another user"));
  EXPECT_TRUE(std::filesystem::is_empty(dir / "folder"));
}

TEST(PidFile, OfADeadProcessIsReplacedWhoeverHasItsNumberNow) {
  const test::TempDir dir;
  const std::string path = dir / "pid";
  std::ofstream(path) << ::getppid() << '\n';
  PidFile file;
  EXPECT_TRUE(file.write(path).has_value());
}

// A limit on the size of files, as on a full disk.
class SmallFiles {
 public:
  SmallFiles() {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    rlimit none = before_;
    none.rlim_cur = 0;
    ::setrlimit(RLIMIT_FSIZE, &none);
  }
  ~SmallFiles() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    (void)std::signal(SIGXFSZ, action_);
  }
  SmallFiles(const SmallFiles&) = delete;
  SmallFiles& operator=(const SmallFiles&) = delete;

 private:
  rlimit before_{};
  void (*action_)(int) = std::signal(SIGXFSZ, SIG_IGN);
};

TEST(PidFile, ThatCannotBeWrittenIsNotLeftBehind) {
  const test::TempDir dir;
  const std::string path = dir / "pid";
  {
    const SmallFiles limit;
    PidFile file;
    const Result<void> written = file.write(path);
    ASSERT_FALSE(written.has_value());
    EXPECT_NE(written.error().message.find("File too large"), std::string::npos) << written.error().message;
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace porttape
