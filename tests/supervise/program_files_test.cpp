// The names by which programs open files, and what they mean here.

#include "libport/supervise/program_files.hpp"

#include <array>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <string>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

std::string folder_of(const ProgramFile& file) {
  return file.folder ? fs::read_symlink("/proc/self/fd/" + std::to_string(file.at())).string() : "none";
}

// As it would be opened from here: the folder and the path.
std::string place_of(const ProgramFile& file) { return folder_of(file) + " " + file.path; }

std::string own(const std::string& name, pid_t thread = ::getpid()) {
  return place_of(own_file(thread, program_file(thread, name, AT_FDCWD)));
}

std::string proc(const std::string& rest) { return "/proc/" + std::to_string(::getpid()) + rest; }

TEST(ProgramFiles, ARelativeNameGoesFromTheProgramsFolder) {
  const test::TempDir dir;
  const std::string folder = fs::canonical(dir.path());
  EXPECT_EQ(place_of(program_file(::getpid(), "/dev/null", AT_FDCWD)), "none /dev/null");
  EXPECT_EQ(place_of(program_file(::getpid(), "a/b", AT_FDCWD)), fs::current_path().string() + " a/b");
  const UniqueFd open(::open(folder.c_str(), O_PATH | O_CLOEXEC));
  EXPECT_EQ(place_of(program_file(::getpid(), "a/b", open.get())), folder + " a/b");
  EXPECT_FALSE(*program_file(::getpid(), "a/b", INT_MAX).folder);
}

TEST(ProgramFiles, NamesOfAProcesssOwnFilesHaveItsNumber) {
  EXPECT_EQ(own("/dev/stdin"), proc("/fd 0"));
  EXPECT_EQ(own("/dev/stdout"), proc("/fd 1"));
  EXPECT_EQ(own("/dev/stderr"), proc("/fd 2"));
  EXPECT_EQ(own("/dev/fd/17"), proc("/fd 17"));
  EXPECT_EQ(own("/dev/fd"), proc("/fd ."));
  EXPECT_EQ(own("//dev/./fd//17"), proc("/fd 17"));
  EXPECT_EQ(own("/proc/self/fd/4"), proc(" fd/4"));
  EXPECT_EQ(own("/proc/self"), proc(" ."));
  EXPECT_EQ(own("/proc/thread-self/fd/4"), proc("/task/" + std::to_string(::getpid()) + " fd/4"));
  for (const char* const other : {"/dev/stdinx", "/dev/fdx/1", "/proc/selfish", "/dev/null", "/nowhere"})
    EXPECT_EQ(own(other), std::string("none ") + other);
}

TEST(ProgramFiles, AThreadHasItsProcesssFiles) {
  pid_t thread = 0;
  std::string of_process;
  std::string of_thread;
  std::thread([&] {
    thread = ::gettid();
    of_process = own("/proc/self/fd/1", thread);
    of_thread = own("/proc/thread-self/fd/1", thread);
  }).join();
  EXPECT_EQ(of_process, proc(" fd/1"));
  EXPECT_EQ(of_thread, proc("/task/" + std::to_string(thread) + " fd/1"));
}

TEST(ProgramFiles, ALinkToSuchANameIsTheProgramsOwn) {
  const test::TempDir dir;
  const std::string folder = fs::canonical(dir.path());
  fs::create_directory(folder + "/sub");
  fs::create_symlink("/dev/stdin", folder + "/input");
  fs::create_symlink("input", folder + "/beside");
  fs::create_symlink("../input", folder + "/sub/up");
  fs::create_symlink("/dev/null", folder + "/null");
  EXPECT_EQ(own(folder + "/input"), proc("/fd 0"));
  EXPECT_EQ(own(folder + "/beside"), proc("/fd 0"));
  EXPECT_EQ(own(folder + "/sub/up"), proc("/fd 0"));
  EXPECT_EQ(own(folder + "/null"), "none " + folder + "/null") << "it stays named as the program has it";
  const UniqueFd open(::open(folder.c_str(), O_PATH | O_CLOEXEC));
  const auto from_folder = [&](const char* name) {
    return place_of(own_file(::getpid(), program_file(::getpid(), name, open.get())));
  };
  EXPECT_EQ(from_folder("beside"), proc("/fd 0"));
  EXPECT_EQ(from_folder("sub/up"), proc("/fd 0"));
  EXPECT_EQ(from_folder("null"), folder + " null");
}

// 40 links, as the kernel follows them.
TEST(ProgramFiles, ALinkOfTooManyIsLeftAlone) {
  const test::TempDir dir;
  const std::string folder = fs::canonical(dir.path());
  fs::create_symlink("/dev/stdin", folder + "/1");
  for (int i = 2; i <= 41; ++i) fs::create_symlink(std::to_string(i - 1), folder + "/" + std::to_string(i));
  EXPECT_EQ(own(folder + "/39"), proc("/fd 0"));
  EXPECT_EQ(own(folder + "/41"), "none " + folder + "/41");
  fs::create_symlink("circle", folder + "/circle");
  EXPECT_EQ(own(folder + "/circle"), "none " + folder + "/circle");
}

TEST(ProgramFiles, WhatIsNamedInProcIsKnownAsThat) {
  const auto in_proc = [](const std::string& name) {
    return own_file(::getpid(), program_file(::getpid(), name, AT_FDCWD)).in_proc;
  };
  EXPECT_TRUE(in_proc("/dev/stdin"));
  EXPECT_TRUE(in_proc("/proc/self/fd/0"));
  EXPECT_TRUE(in_proc("/proc/1/fd/0"));
  EXPECT_FALSE(in_proc("/dev/null"));
  const test::TempDir dir;
  fs::create_symlink("/proc/1/fd/0", dir / "link");
  EXPECT_FALSE(in_proc(dir / "link"));
  EXPECT_EQ(own(dir / "link"), "none " + (dir / "link"));
}

TEST(ProgramFiles, AMagicLinkIsFoundOut) {
  const test::TempDir dir;
  fs::create_symlink("/proc/self/fd/0", dir / "link");
  fs::create_symlink("/dev/null", dir / "null");
  EXPECT_TRUE(leads_through_process({.path = "/proc/self/fd/0"}));
  EXPECT_TRUE(leads_through_process({.path = dir / "link"}));
  EXPECT_FALSE(leads_through_process({.path = dir / "null"}));
  EXPECT_FALSE(leads_through_process({.path = dir / "none"}));
}

// Of a file whose name is in the kernel's cache. A mount or a rename of somebody else's, just then, hides
// that.
QuickLook look_again(const ProgramFile& file) {
  QuickLook look = look_at_once(file);
  for (int n = 0; n < 10000 && !look.known; ++n) look = look_at_once(file);
  return look;
}

TEST(ProgramFiles, ADeviceIsKnownAtOnceOrLater) {
  const test::TempDir dir;
  std::ofstream(dir / "file") << "text";
  struct stat null {};
  ASSERT_EQ(::stat("/dev/null", &null), 0);
  const auto number = [](const std::optional<TtyDevice>& device) { return device ? device->number : 0; };
  EXPECT_EQ(number(tty_device_at(ProgramFile{.path = "/dev/null"})), null.st_rdev);
  EXPECT_EQ(number(tty_device_at(ProgramFile{.path = dir / "file"})), 0U);
  EXPECT_EQ(number(tty_device_at(ProgramFile{.path = dir / "none"})), 0U);
  const QuickLook look = look_again({.path = "/dev/null"});
  EXPECT_TRUE(look.known);
  EXPECT_EQ(number(look.device), null.st_rdev);
  const UniqueFd folder(::open("/dev", O_PATH | O_CLOEXEC));
  const ProgramFile relative = program_file(::getpid(), "null", folder.get());
  EXPECT_EQ(number(look_again(relative).device), null.st_rdev);
  EXPECT_EQ(number(tty_device_at(relative)), null.st_rdev);
  const QuickLook file = look_again({.path = dir / "file"});
  EXPECT_TRUE(file.known);
  EXPECT_FALSE(file.device.has_value());
  EXPECT_FALSE(look_at_once({.path = "/proc/self/fd/0"}).known);
  EXPECT_FALSE(look_at_once(program_file(::getpid(), "x", INT_MAX)).known);
}

TEST(ProgramFiles, ATerminalOfAPtyHasItsFileSystem) {
  const UniqueFd master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_EQ(::grantpt(master.get()), 0);
  ASSERT_EQ(::unlockpt(master.get()), 0);
  const std::string name = ::ptsname(master.get());
  struct stat status {};
  ASSERT_EQ(::stat(name.c_str(), &status), 0);
  for (const auto& device : {look_again({.path = name}).device, tty_device_at(ProgramFile{.path = name})}) {
    ASSERT_TRUE(device.has_value());
    EXPECT_EQ(device->number, status.st_rdev);
    EXPECT_EQ(device->file_system, status.st_dev);
  }
}

TEST(ProgramFiles, WhereTheKernelHasNoQuickLookNothingIsKnown) {
  for (const test::RefusedCall& refused :
       {test::RefusedCall{SYS_openat2, ENOSYS}, test::RefusedCall{SYS_openat2, EAGAIN},
        test::RefusedCall{SYS_statx, EIO}}) {
    EXPECT_TRUE(test::holds_without({refused}, [] {
      const QuickLook look = look_at_once({.path = "/dev/null"});
      EXPECT_FALSE(look.known);
      EXPECT_FALSE(look.device.has_value());
    }));
  }
  for (const int error : {ENOENT, ENOTDIR, EACCES}) {
    EXPECT_TRUE(test::holds_without({{SYS_openat2, error}}, [] {
      const QuickLook look = look_at_once({.path = "/dev/null"});
      EXPECT_TRUE(look.known);
      EXPECT_FALSE(look.device.has_value());
    }));
  }
}

// Whether a child's next terminal is its controlling one, as it sees that itself.
bool child_gets(bool own_session, bool has_one, bool as_thread) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (own_session) ::setsid();
    if (has_one) {
      const UniqueFd master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
      ::grantpt(master.get());
      ::unlockpt(master.get());
      const UniqueFd slave(::open(::ptsname(master.get()), O_RDWR | O_CLOEXEC));
      const bool gets = gets_terminal(::getpid());
      ::_exit(gets ? 1 : 0);
    }
    bool gets = false;
    if (as_thread)
      std::thread([&] { gets = gets_terminal(::gettid()); }).join();
    else
      gets = gets_terminal(::getpid());
    ::_exit(gets ? 1 : 0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 1;
}

TEST(ProgramFiles, ASessionsFirstProcessWithoutATerminalGetsOne) {
  EXPECT_TRUE(child_gets(true, false, false));
  EXPECT_TRUE(child_gets(true, false, true));
  EXPECT_FALSE(child_gets(false, false, false));
  EXPECT_FALSE(child_gets(true, true, false));
  const pid_t ended = ::fork();
  if (ended == 0) ::_exit(0);
  ::waitpid(ended, nullptr, 0);
  EXPECT_FALSE(gets_terminal(ended));
}

}  // namespace
}  // namespace porttape
