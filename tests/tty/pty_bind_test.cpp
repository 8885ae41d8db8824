#include "libport/tty/pty_bind.hpp"

#include <array>
#include <cerrno>
#include <cstddef>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <memory>
#include <optional>
#include <sched.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/tty/pty.hpp"
#include "libport/tty/pty_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// This process has no such system call any more.
bool forbid(unsigned call) {
  std::array<sock_filter, 4> code = {
      sock_filter BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
      sock_filter BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, call, 0, 1),
      sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS),
      sock_filter BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)};
  const sock_fprog program{static_cast<unsigned short>(code.size()), code.data()};
  return ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

// In mounts of its own, of which the system sees nothing.
class PtyBindTest : public testing::Test {
 protected:
  void SetUp() override {
    if (::unshare(CLONE_NEWNS) != 0 || ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0)
      GTEST_SKIP() << "needs CAP_SYS_ADMIN, to mount";
  }
  void TearDown() override {
    while (::umount2(path.c_str(), MNT_DETACH) == 0) {
    }
  }

  Pty make_pty() {
    Result<Pty> pty = Pty::create(loop.file_events(), {});
    return std::move(*pty);
  }
  // The path leads to this pty.
  void expect_leads_to(const Pty& pty) const {
    struct stat there {};
    struct stat slave {};
    ASSERT_EQ(::stat(path.c_str(), &there), 0);
    ASSERT_EQ(::stat(pty.slave_path().c_str(), &slave), 0);
    EXPECT_EQ(there.st_rdev, slave.st_rdev);
    const UniqueFd fd(::open(path.c_str(), O_RDWR | O_NOCTTY));
    EXPECT_EQ(::isatty(fd.get()), 1);
  }
  void make_file(std::string_view content) const { std::ofstream(path) << content; }
  [[nodiscard]] std::string error() {
    const Pty pty = make_pty();
    const Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
    EXPECT_FALSE(bind.has_value());
    if (bind) return {};
    EXPECT_EQ(bind.error().code, Errc::usage);
    EXPECT_THAT(bind.error().message, HasSubstr(path));
    return bind.error().message;
  }

  test::TempDir dir;
  const std::string path = (dir.path() / "a port").string();
  Loop loop;
};

TEST_F(PtyBindTest, IsThereAsLongAsItLives) {
  const Pty pty = make_pty();
  {
    const Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
    ASSERT_TRUE(bind.has_value()) << bind.error().message;
    expect_leads_to(pty);
    EXPECT_FALSE(fs::is_symlink(path));
  }
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(PtyBindTest, AnEmptyFileThatWasThereStays) {
  make_file("");
  const Pty pty = make_pty();
  {
    const Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
    ASSERT_TRUE(bind.has_value()) << bind.error().message;
    expect_leads_to(pty);
  }
  EXPECT_TRUE(fs::is_regular_file(path));
}

TEST_F(PtyBindTest, WhatIsInUseIsLeftAlone) {
  make_file("data");
  EXPECT_THAT(error(), HasSubstr("not an empty file"));
  EXPECT_EQ(fs::file_size(path), 4U);
  fs::remove(path);
  fs::create_symlink("/nowhere", path);
  EXPECT_THAT(error(), HasSubstr("not an empty file"));
  fs::remove(path);
  fs::create_directory(path);
  EXPECT_THAT(error(), HasSubstr("not an empty file"));
  fs::remove(path);
  const Pty other = make_pty();
  const Result<PtyBind> bind = PtyBind::publish(path, other.slave_path());
  EXPECT_THAT(error(), HasSubstr("in use"));
  expect_leads_to(other);
}

TEST_F(PtyBindTest, AMissingFolderIsAnErrorThatSaysWhatToType) {
  const Pty pty = make_pty();
  const Result<PtyBind> bind = PtyBind::publish((dir.path() / "no" / "port").string(), pty.slave_path());
  ASSERT_FALSE(bind.has_value());
  EXPECT_EQ(bind.error().code, Errc::usage);
  EXPECT_THAT(bind.error().message, HasSubstr("mkdir -p"));
}

TEST_F(PtyBindTest, MovesToAnotherPtyAndAnOpenDriverKeepsItsOwn) {
  std::optional<Pty> first(make_pty());
  Result<PtyBind> bind = PtyBind::publish(path, first->slave_path());
  ASSERT_TRUE(bind.has_value());
  const UniqueFd driver(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  for (int n = 0; n < 20; ++n) {
    const Pty next = make_pty();
    const Result<void> moved = bind->retarget(next.slave_path());
    ASSERT_TRUE(moved.has_value()) << moved.error().message;
    expect_leads_to(next);
  }
  EXPECT_EQ(::isatty(driver.get()), 1);
  EXPECT_EQ(::umount2(path.c_str(), MNT_DETACH), 0);
  EXPECT_TRUE(fs::is_regular_file(path)) << "one mount, whatever was mounted before";
}

// Before Linux 6.5 nothing can be mounted beneath.
TEST_F(PtyBindTest, MovesToAnotherPtyOnAnOlderKernelToo) {
  const pid_t child = ::fork();
  if (child == 0) {
    const Pty first = make_pty();
    Result<PtyBind> bind = PtyBind::publish(path, first.slave_path());
    if (!bind || !forbid(SYS_move_mount)) ::_exit(2);
    for (int n = 0; n < 3; ++n) {
      const Pty next = make_pty();
      if (!bind->retarget(next.slave_path())) ::_exit(3);
      expect_leads_to(next);
    }
    ::umount2(path.c_str(), MNT_DETACH);
    ::_exit(HasFailure() ? 4 : fs::is_regular_file(path) ? 0 : 5);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0) << WEXITSTATUS(status);
}

TEST_F(PtyBindTest, WhatAKilledProgramLeftIsReplacedAndTakenAway) {
  for (int n = 0; n < 3; ++n) {
    const pid_t child = ::fork();
    if (child == 0) {
      Loop own;
      Result<Pty> pty = Pty::create(own.file_events(), {});
      const Result<PtyBind> bind = PtyBind::publish(path, pty->slave_path());
      ::_exit(bind ? 0 : 1);  // nothing is taken away
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_EQ(status, 0) << n;
    ASSERT_TRUE(fs::exists(path));
  }
  const Pty pty = make_pty();
  {
    const Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
    ASSERT_TRUE(bind.has_value()) << bind.error().message;
    expect_leads_to(pty);
  }
  EXPECT_FALSE(fs::exists(path)) << "the file is known again";
}

TEST_F(PtyBindTest, WhatSomebodyElseMountedMeanwhileIsLeftAlone) {
  const Pty pty = make_pty();
  const Pty other = make_pty();
  {
    Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
    ASSERT_TRUE(bind.has_value());
    ASSERT_EQ(::mount(other.slave_path().c_str(), path.c_str(), nullptr, MS_BIND, nullptr), 0);
    EXPECT_FALSE(bind->retarget(pty.slave_path()).has_value());
  }
  expect_leads_to(other);
}

TEST_F(PtyBindTest, ItsMountGoesWithItWhereverItsFolderHasMovedTo) {
  const Pty pty = make_pty();
  const Pty next = make_pty();
  const std::string folder = dir / "folder";
  fs::create_directory(folder);
  {
    Result<PtyBind> bind = PtyBind::publish(folder + "/port", pty.slave_path());
    ASSERT_TRUE(bind.has_value()) << bind.error().message;
    fs::rename(folder, folder + ".moved");
    fs::create_directory(folder);
    std::ofstream(folder + "/port") << "";
    ASSERT_TRUE(bind->retarget(next.slave_path()).has_value());
    EXPECT_TRUE(fs::is_regular_file(folder + "/port"));
    EXPECT_TRUE(fs::is_character_file(folder + ".moved/port"));
  }
  EXPECT_TRUE(fs::is_regular_file(folder + "/port")) << "another file, of somebody else";
  EXPECT_FALSE(fs::exists(folder + ".moved/port"));
}

TEST_F(PtyBindTest, WhatReplacedItsFileIsNotMountedOn) {
  const Pty pty = make_pty();
  {
    Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
    ASSERT_TRUE(bind.has_value()) << bind.error().message;
    ASSERT_EQ(::umount2(path.c_str(), MNT_DETACH), 0);
    fs::remove(path);
    make_file("");
    const auto descriptors = [] { return std::distance(fs::directory_iterator("/proc/self/fd"), {}); };
    const auto before = descriptors();
    const Result<void> moved = bind->retarget(pty.slave_path());
    ASSERT_FALSE(moved.has_value());
    EXPECT_EQ(descriptors(), before - 1) << "that of what is mounted no more is closed";
    EXPECT_EQ(moved.error().message,
              "option 'bind': '" + path + "': something else is there by now; it is left alone");
  }
  EXPECT_TRUE(fs::is_regular_file(path));
}

TEST_F(PtyBindTest, AnotherUsersLinkLeadsNowhere) {
  const std::string real = dir / "real";
  fs::create_directory(real);
  const std::string link = dir / "link";
  const Pty pty = make_pty();
  ASSERT_EQ(::symlink(real.c_str(), link.c_str()), 0);
  {
    const Result<PtyBind> bind = PtyBind::publish(link + "/port", pty.slave_path());
    ASSERT_TRUE(bind.has_value()) << bind.error().message;
    EXPECT_TRUE(fs::is_character_file(real + "/port")) << "by a link of our own";
  }
  if (::lchown(link.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "needs root, to give a link away";
  const Result<PtyBind> bind = PtyBind::publish(link + "/port", pty.slave_path());
  ASSERT_FALSE(bind.has_value());
  EXPECT_EQ(bind.error().message, "option 'bind': '" + link +
                                      "/port': 'link' on the way there is a link that another user made; "
                                      "name the folder itself");
  EXPECT_TRUE(fs::is_empty(real));
}

TEST_F(PtyBindTest, APortHasBothNamesAndMovesBothWhenItHangsUp) {
  LogBook book;
  PortLog log;
  const std::string link = (dir.path() / "link").string();
  auto port =
      std::make_unique<PtyPort>(PortContext{&loop, book.log()}, PtyOptions{.link = link, .bind = path});
  port->listen(log);
  const Result<void> prepared = port->prepare();
  ASSERT_TRUE(prepared.has_value()) << prepared.error().message;
  port->open();
  std::string expected;
  for (const std::string& name : {link, path, link, path}) {
    const UniqueFd driver(::open(name.c_str(), O_RDWR | O_NOCTTY));
    expected += "up ";
    run_until(loop, [&] { return log.events == expected; });
    ASSERT_EQ(::write(driver.get(), "x", 1), 1);
    run_until(loop, [&] { return log.data == "x"; });
    log.data.clear();
    port->hang_up(false);
    expected += "hung_up ";
    run_until(loop, [&] { return log.events == expected; });
    EXPECT_EQ(log.events, expected);
  }
  port.reset();
  EXPECT_TRUE(fs::is_empty(dir.path()));
}

TEST_F(PtyBindTest, AnErrorOfOneNameLeavesNoneBehind) {
  make_file("data");
  LogBook book;
  const std::string link = (dir.path() / "link").string();
  PtyPort port(PortContext{&loop, book.log()}, PtyOptions{.link = link, .bind = path});
  EXPECT_FALSE(port.prepare().has_value());
  EXPECT_FALSE(fs::is_symlink(link));
}

TEST(PtyBindUnprivileged, WithoutTheRightAnErrorSaysWhatToDoAndNothingIsLeft) {
  const test::TempDir dir;
  const std::string path = (dir.path() / "port").string();
  fs::permissions(dir.path(), fs::perms::all);
  const pid_t child = ::fork();
  if (child == 0) {
    if (::geteuid() == 0 && ::setresuid(65534, 65534, 65534) != 0) ::_exit(2);
    Loop loop;
    const Result<Pty> pty = Pty::create(loop.file_events(), {});
    const Result<PtyBind> bind = PtyBind::publish(path, pty->slave_path());
    const bool told = !bind && bind.error().code == Errc::usage &&
                      bind.error().message.find("CAP_SYS_ADMIN") != std::string::npos;
    ::_exit(!told ? 3 : fs::exists(path) ? 4 : 0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0) << WEXITSTATUS(status);
}

TEST_F(PtyBindTest, ACallThatFailsIsToldAndLeavesNothing) {
  const std::string no_right =
      "; it needs CAP_SYS_ADMIN: start it as root (in a container with --cap-add SYS_ADMIN), or use "
      "link=PATH, "
      "which needs nothing";
  const std::pair<std::vector<test::RefusedCall>, std::string> cases[] = {
      {{{SYS_open_tree, EPERM}}, "cannot be mounted on: Operation not permitted" + no_right},
      {{{SYS_move_mount, EACCES}}, "cannot be mounted on: Permission denied" + no_right},
      {{{SYS_move_mount, EINVAL}}, "cannot be mounted on: Invalid argument"},
      {{{SYS_open_tree, EMFILE}}, "cannot be mounted on: Too many open files"},
      {{{SYS_open_tree, ENOSYS}, {SYS_mount, EPERM}},
       "cannot be mounted on: Operation not permitted" + no_right},
      {{{SYS_move_mount, ENOSYS}, {SYS_mount, EINVAL}}, "cannot be mounted on: Invalid argument"},
      {{test::refused_open(O_CREAT | O_EXCL, EROFS)}, "cannot be made: Read-only file system"},
      {{test::refused_open(O_CREAT | O_EXCL, ENOSPC)}, "cannot be made: No space left on device"}};
  const Pty pty = make_pty();
  for (const auto& [calls, text] : cases) {
    EXPECT_TRUE(test::while_refused(calls, [&, why = text] {
      const Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
      ASSERT_FALSE(bind.has_value()) << why;
      EXPECT_EQ(bind.error(), make_error(Errc::usage, "option 'bind': '" + path + "': " + why));
    }));
    EXPECT_FALSE(fs::exists(path)) << text;
  }
  const Result<PtyBind> bind = PtyBind::publish(path, pty.slave_path());
  ASSERT_TRUE(bind.has_value());
  expect_leads_to(pty);
}

TEST_F(PtyBindTest, WhereItCannotBeMovedBeneathTheOldOneGoesFirst) {
  const Pty first = make_pty();
  const Pty second = make_pty();
  Result<PtyBind> bind = PtyBind::publish(path, first.slave_path());
  ASSERT_TRUE(bind.has_value());
  const test::RefusedCall::Argument beneath{4, 0x200, 0x200};
  EXPECT_TRUE(test::while_refused({{SYS_move_mount, EINVAL, beneath}},
                                  [&] { EXPECT_TRUE(bind->retarget(second.slave_path()).has_value()); }));
  expect_leads_to(second);
}

TEST_F(PtyBindTest, AMoveThatFailsIsToldAndThePathIsFree) {
  const Pty first = make_pty();
  const Pty second = make_pty();
  Result<PtyBind> bind = PtyBind::publish(path, first.slave_path());
  ASSERT_TRUE(bind.has_value());
  EXPECT_TRUE(test::while_refused({{SYS_move_mount, ENOMEM}}, [&] {
    const Result<void> moved = bind->retarget(second.slave_path());
    ASSERT_FALSE(moved.has_value());
    EXPECT_THAT(moved.error().message, HasSubstr("cannot be mounted on: Cannot allocate memory"));
  }));
  EXPECT_TRUE(fs::is_regular_file(path)) << "no pty of a driver that is gone";
  EXPECT_TRUE(bind->retarget(second.slave_path()).has_value());
  expect_leads_to(second);
}

}  // namespace
}  // namespace porttape
