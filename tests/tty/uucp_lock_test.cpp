#include "libport/tty/uucp_lock.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

pid_t dead_process() {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  return child;
}

std::string binary(pid_t pid) { return {reinterpret_cast<const char*>(&pid), sizeof pid}; }

class UucpLockTest : public testing::Test {
 protected:
  UucpLockTest() {
    fs::create_directory(dir.path() / "locks");
    fs::create_directory(dir.path() / "by-id");
    std::ofstream(dir.path() / "ttyUSB0") << "";
    fs::create_symlink("../ttyUSB0", dir.path() / "by-id" / "usb-x");
  }

  void lock(const std::string& name, const std::string& content) {
    fs::remove(dir.path() / "locks" / name);
    std::ofstream(dir.path() / "locks" / name) << content;
  }
  [[nodiscard]] std::string content(const std::string& name) const {
    std::ifstream file(dir.path() / "locks" / name);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : fs::directory_iterator(folder)) all.push_back(entry.path().filename());
    return all;
  }
  [[nodiscard]] auto holder() const { return uucp_holder(folder, device, dir.path().string()); }

  test::TempDir dir;
  const std::string folder = (dir.path() / "locks").string();
  const std::string device = (dir.path() / "by-id" / "usb-x").string();
  const pid_t alive = ::getppid();
};

TEST_F(UucpLockTest, ALivingProcessHasItByEitherNameInEitherFormat) {
  for (const std::string name : {"LCK..ttyUSB0", "LCK..usb-x"}) {
    for (const std::string& text : {fmt::format("{:>10}\n", alive), fmt::format("{}", alive),
                                    fmt::format("{:>10} minicom root\n", alive), binary(alive)}) {
      lock(name, text);
      ASSERT_TRUE(holder()) << text;
      EXPECT_EQ(holder()->pid, alive);
      EXPECT_THAT(holder()->file, HasSubstr(name));
      EXPECT_THAT(to_text(*holder()), HasSubstr(std::to_string(alive)));
      EXPECT_THAT(to_text(*holder()), HasSubstr("remove the file"));
    }
    fs::remove(dir.path() / "locks" / name);
  }
  EXPECT_FALSE(holder());
}

// The bytes of some numbers begin like text: those of 8241 are a `1`, a blank and two zeros.
TEST_F(UucpLockTest, ABinaryNumberThatBeginsLikeTextIsANumber) {
  for (const char blank : {' ', '\t', '\r', '\n'}) {
    const pid_t number = blank * 256 + '1';
    lock("LCK..ttyUSB0", binary(number));
    const bool lives = ::kill(number, 0) == 0 || errno == EPERM;
    ASSERT_EQ(holder().has_value(), lives) << number << ": process 1 lives and has no lock";
    if (lives) {
      EXPECT_EQ(holder()->pid, number);
    }
  }
}

TEST_F(UucpLockTest, OutsideTheDevicesFolderTheNameGivenSaysNothing) {
  lock("LCK..usb-x", fmt::format("{}\n", alive));
  EXPECT_TRUE(holder());
  EXPECT_FALSE(uucp_holder(folder, device)) << "another device of that name";
  lock("LCK..ttyUSB0", fmt::format("{}\n", alive));
  EXPECT_TRUE(uucp_holder(folder, device));
}

TEST_F(UucpLockTest, TheProgramIsNamed) {
  std::ifstream comm(fmt::format("/proc/{}/comm", alive));
  std::string name;
  std::getline(comm, name);
  lock("LCK..ttyUSB0", fmt::format("{}\n", alive));
  EXPECT_EQ(holder()->program, name);
}

TEST_F(UucpLockTest, WhatNamesNoLivingProcessIsNobodys) {
  const pid_t dead = dead_process();
  for (const std::string& text :
       {fmt::format("{:>10}\n", dead), binary(dead), fmt::format("{:>10}\n", ::getpid()), std::string(),
        std::string("-1\n"), std::string("0\n"), std::string("no number at all\n"), std::string(1000, '9'),
        binary(0), binary(-1), std::string("99999999999999999999\n")}) {
    lock("LCK..ttyUSB0", text);
    EXPECT_FALSE(holder()) << text;
  }
  fs::remove(dir.path() / "locks" / "LCK..ttyUSB0");
  fs::create_directory(dir.path() / "locks" / "LCK..ttyUSB0");
  EXPECT_FALSE(holder()) << "a folder";
  fs::remove(dir.path() / "locks" / "LCK..ttyUSB0");
  ASSERT_EQ(::mkfifo((folder + "/LCK..ttyUSB0").c_str(), 0600), 0);
  EXPECT_FALSE(holder()) << "a pipe, which would make us wait";
  fs::remove_all(folder);
  EXPECT_FALSE(holder()) << "no such folder";
}

TEST_F(UucpLockTest, BothNamesAreLockedAndSoLongAsItLives) {
  {
    const Result<UucpLock> lock = UucpLock::take(folder, device, dir.path().string());
    ASSERT_TRUE(lock.has_value()) << lock.error().message;
    EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0", "LCK..usb-x"));
    EXPECT_EQ(content("LCK..ttyUSB0"), fmt::format("{:>10}\n", ::getpid()));
    EXPECT_EQ(fs::status(folder + "/LCK..ttyUSB0").permissions(), static_cast<fs::perms>(0644));
  }
  EXPECT_THAT(names(), IsEmpty());
}

TEST_F(UucpLockTest, ADevicesOwnPathHasOneLock) {
  const Result<UucpLock> lock = UucpLock::take(folder, (dir.path() / "ttyUSB0").string());
  ASSERT_TRUE(lock.has_value());
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0"));
}

TEST_F(UucpLockTest, LocksOfDeadProcessesAreReplaced) {
  lock("LCK..ttyUSB0", fmt::format("{:>10}\n", dead_process()));
  lock("LCK..usb-x", binary(dead_process()));
  const Result<UucpLock> lock = UucpLock::take(folder, device, dir.path().string());
  ASSERT_TRUE(lock.has_value()) << lock.error().message;
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0", "LCK..usb-x"));
  EXPECT_EQ(content("LCK..usb-x"), fmt::format("{:>10}\n", ::getpid()));
}

TEST_F(UucpLockTest, AnothersLockStaysAndNothingOfOursIsLeft) {
  const std::string others = fmt::format("{:>10}\n", alive);
  lock("LCK..usb-x", others);  // the second one that is taken
  const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
  ASSERT_FALSE(taken.has_value());
  EXPECT_EQ(taken.error().code, Errc::device_missing);
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..usb-x"));
  EXPECT_EQ(content("LCK..usb-x"), others);
}

TEST_F(UucpLockTest, AFileThatHoldsNoNumberIsNotTouched) {
  lock("LCK..ttyUSB0", "something else");
  const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
  ASSERT_FALSE(taken.has_value());
  EXPECT_EQ(taken.error().code, Errc::io);
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0"));
  EXPECT_EQ(content("LCK..ttyUSB0"), "something else");
}

TEST_F(UucpLockTest, ALinkIsNobodysAndIsNotTouched) {
  std::ofstream(dir.path() / "elsewhere") << alive << '\n';
  fs::create_symlink("../elsewhere", dir.path() / "locks" / "LCK..ttyUSB0");
  EXPECT_FALSE(holder());
  EXPECT_FALSE(UucpLock::take(folder, device, dir.path().string()).has_value());
  EXPECT_TRUE(fs::is_symlink(dir.path() / "locks" / "LCK..ttyUSB0"));
}

TEST_F(UucpLockTest, ALockThatBecameAnothersIsLeft) {
  {
    const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
    ASSERT_TRUE(taken.has_value());
    lock("LCK..ttyUSB0", fmt::format("{:>10}\n", alive));
  }
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0"));
}

TEST_F(UucpLockTest, AFolderThatIsMissingIsAnErrorThatNamesIt) {
  fs::remove_all(folder);
  const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
  ASSERT_FALSE(taken.has_value());
  EXPECT_EQ(taken.error().code, Errc::io);
  EXPECT_THAT(taken.error().message, HasSubstr(folder));
}

TEST_F(UucpLockTest, AMessageSaysWhoHasItAndWhatIsToBeDone) {
  EXPECT_EQ(
      to_text({.file = "/var/lock/LCK..ttyUSB0", .pid = 17, .program = "minicom"}),
      "process 17 ('minicom') has it, says '/var/lock/LCK..ttyUSB0': end that program, or remove the file "
      "if it does not use the device any more");
  EXPECT_EQ(
      to_text({.file = "/l", .pid = 17}),
      "process 17 has it, says '/l': end that program, or remove the file if it does not use the device "
      "any more");
}

TEST_F(UucpLockTest, AnErrorSaysWhatCannotBeMadeAndWhy) {
  const std::string rest = "; other programs are not told that the device is in use";
  const std::string file = folder + "/LCK..ttyUSB0";
  lock("LCK..ttyUSB0", "something else");
  EXPECT_EQ(UucpLock::take(folder, device).error().message,
            "no lock can be made: '" + file + "': File exists" + rest);
  lock("LCK..ttyUSB0", fmt::format("{}\n", alive));
  const Result<UucpLock> others = UucpLock::take(folder, device);
  ASSERT_FALSE(others.has_value());
  EXPECT_EQ(others.error().message, to_text(*holder()));
  fs::remove_all(folder);
  EXPECT_EQ(UucpLock::take(folder, device).error().message,
            "no lock can be made: '" + folder + "': No such file or directory" + rest);
}

TEST_F(UucpLockTest, OthersMayReadItWhateverTheUmaskIs) {
  const mode_t before = ::umask(077);
  const Result<UucpLock> taken = UucpLock::take(folder, device);
  ::umask(before);
  ASSERT_TRUE(taken.has_value());
  EXPECT_EQ(fs::status(folder + "/LCK..ttyUSB0").permissions(), static_cast<fs::perms>(0644));
}

TEST_F(UucpLockTest, ADeviceThatIsNotThereIsKnownByTheNameGiven) {
  const std::string missing = (dir.path() / "ttyUSB7").string();
  lock("LCK..ttyUSB7", fmt::format("{}\n", alive));
  EXPECT_TRUE(uucp_holder(folder, missing, dir.path().string()));
  EXPECT_FALSE(uucp_holder(folder, missing, dir.path().string() + "/ttyUSB")) << "not below that folder";
  const Result<UucpLock> taken = UucpLock::take(folder, missing);
  ASSERT_TRUE(taken.has_value());
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB7"));
}

TEST_F(UucpLockTest, OfTwoHoldersTheDevicesOwnComesFirst) {
  lock("LCK..ttyUSB0", fmt::format("{}\n", alive));
  lock("LCK..usb-x", "1\n");
  EXPECT_EQ(holder()->pid, alive);
  lock("LCK..ttyUSB0", fmt::format("{}\n", dead_process()));
  EXPECT_EQ(holder()->pid, 1);
}

TEST_F(UucpLockTest, OurOwnLockIsNoHolder) {
  const Result<UucpLock> first = UucpLock::take(folder, device);
  ASSERT_TRUE(first.has_value());
  EXPECT_FALSE(holder()) << "nobody else's";
  EXPECT_EQ(content("LCK..ttyUSB0"), fmt::format("{:>10}\n", ::getpid()));
}

TEST_F(UucpLockTest, AFolderWithoutRightsIsAnError) {
  if (::geteuid() == 0) {
    const pid_t child = ::fork();
    if (child == 0) {
      fs::permissions(folder, fs::perms(0555));
      fs::permissions(dir.path(), fs::perms(0755));
      if (::setresuid(65534, 65534, 65534) != 0) ::_exit(2);
      const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
      ::_exit(!taken && taken.error().code == Errc::io ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(status, 0);
    return;
  }
  fs::permissions(folder, fs::perms(0555));
  const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
  EXPECT_TRUE(!taken && taken.error().code == Errc::io);
}

// What cannot be made is told with its place and the reason, and leaves nothing.
TEST_F(UucpLockTest, ACallThatFailsIsToldAndLeavesNothing) {
  struct Case {
    test::RefusedCall refused;
    std::string place;
    std::string why;
  };
  const std::string file = folder + "/LCK..ttyUSB0";
  const Case cases[] = {
      {test::refused_open(O_CREAT | O_EXCL, EROFS), folder, "Read-only file system"},
      {test::refused_open(O_CREAT | O_EXCL, ENOSPC), folder, "No space left on device"},
      {test::refused_open(O_CREAT | O_EXCL, EMFILE), folder, "Too many open files"},
      {{SYS_write, EIO}, folder, "Input/output error"},
      {{SYS_write, EDQUOT}, folder, "Disk quota exceeded"},
      {{SYS_write, 0}, folder, "No space left on device"},  // it wrote less than all
      {{SYS_fchmod, EPERM}, folder, "Operation not permitted"},
#ifdef SYS_link
      {{SYS_link, EPERM}, file, "Operation not permitted"},
      {{SYS_link, EMLINK}, file, "Too many links"},
      {{SYS_link, EEXIST}, file, "File exists"},
#endif
  };
  for (const auto& [refused, place, why] : cases) {
    EXPECT_TRUE(test::while_refused({refused}, [&, place = place, why = why] {
      errno = 0;
      const Result<UucpLock> taken = UucpLock::take(folder, device, dir.path().string());
      ASSERT_FALSE(taken.has_value()) << why;
      EXPECT_EQ(taken.error(), make_error(Errc::io, "no lock can be made: '" + place + "': " + why +
                                                        "; other programs are not told that the device is "
                                                        "in use"));
    }));
    EXPECT_THAT(names(), IsEmpty()) << why;
  }
}

#ifdef SYS_rename
TEST_F(UucpLockTest, ALockOfADeadProcessThatCannotBePutAwayStays) {
  const std::string others = fmt::format("{:>10}\n", dead_process());
  lock("LCK..ttyUSB0", others);
  EXPECT_TRUE(test::while_refused({{SYS_rename, EPERM}}, [&] {
    const Result<UucpLock> taken = UucpLock::take(folder, device);
    ASSERT_FALSE(taken.has_value());
    EXPECT_EQ(taken.error().code, Errc::io) << "nobody has the device";
    EXPECT_THAT(taken.error().message, HasSubstr("LCK..ttyUSB0': File exists"));
  }));
  EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0"));
  EXPECT_EQ(content("LCK..ttyUSB0"), others);
}
#endif

TEST_F(UucpLockTest, AProcessThatMayNotBeSignalledLivesAndOneThatIsNotThereDoesNot) {
  lock("LCK..ttyUSB0", fmt::format("{}\n", alive));
  EXPECT_TRUE(test::while_refused({{SYS_kill, EPERM}}, [&] { EXPECT_TRUE(holder()); }));
  EXPECT_TRUE(test::while_refused({{SYS_kill, ESRCH}}, [&] { EXPECT_FALSE(holder()); }));
}

TEST_F(UucpLockTest, ALockThatCannotBeReadIsNobodysAndIsNotTouched) {
  const std::string others = fmt::format("{}\n", alive);
  lock("LCK..ttyUSB0", others);
  const std::vector<test::RefusedCall> cases[] = {
      {test::refused_open(O_NOFOLLOW | O_NONBLOCK, EACCES)},
      {test::refused_open(O_NOFOLLOW | O_NONBLOCK, ELOOP)},
      {{SYS_fstat, EIO}, {SYS_newfstatat, EIO, test::RefusedCall::Argument{3, AT_EMPTY_PATH, AT_EMPTY_PATH}}},
      {{SYS_read, EIO}}};
  for (const auto& calls : cases) {
    EXPECT_TRUE(test::while_refused(calls, [&] {
      EXPECT_FALSE(holder());
      EXPECT_EQ(UucpLock::take(folder, device).error().code, Errc::io) << "others are not told";
    }));
    EXPECT_EQ(content("LCK..ttyUSB0"), others);
    EXPECT_THAT(names(), UnorderedElementsAre("LCK..ttyUSB0"));
  }
}

}  // namespace
}  // namespace porttape
