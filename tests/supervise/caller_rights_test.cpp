// Processes that have given up something, looked at from outside.

#include "libport/supervise/caller_rights.hpp"

#include <array>
#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <functional>
#include <grp.h>
#include <linux/capability.h>
#include <sched.h>
#include <string>
#include <sys/fsuid.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

constexpr const char* kOtherRights = "it has not the rights that porttape has";
constexpr const char* kOtherUsers = "its rights are those of another user namespace";
constexpr const char* kOtherFiles = "the files that it sees are others";

// A child that has done `change` and waits. `made` is false where that failed.
class ChangedChild {
 public:
  explicit ChangedChild(const std::function<bool()>& change) {
    std::array<int, 2> pair{};
    if (::pipe2(pair.data(), O_CLOEXEC) != 0) std::abort();
    const UniqueFd from(pair[0]);
    UniqueFd to(pair[1]);
    pid = ::fork();
    if (pid == 0) {
      const char done = change() ? 'y' : 'n';
      (void)!::write(to.get(), &done, 1);
      for (;;) ::pause();
    }
    to.reset();
    char done = 'n';
    made = ::read(from.get(), &done, 1) == 1 && done == 'y';
  }
  ~ChangedChild() {
    ::kill(pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
  }
  ChangedChild(const ChangedChild&) = delete;
  ChangedChild& operator=(const ChangedChild&) = delete;

  pid_t pid = -1;
  bool made = false;
};

bool drop_capability(unsigned number) {
  __user_cap_header_struct head{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, 2> halves{};
  if (::syscall(SYS_capget, &head, halves.data()) != 0) return false;
  halves.at(number / 32).effective &= ~(1U << number % 32);
  return ::syscall(SYS_capset, &head, halves.data()) == 0;
}

bool set_groups(const std::vector<gid_t>& groups) { return ::setgroups(groups.size(), groups.data()) == 0; }

class CallerRights : public testing::Test {
 protected:
  void SetUp() override {
    if (::geteuid() != 0) GTEST_SKIP() << "needs root, which has rights to give up";
  }
};

TEST(CallerRightsOfAnybody, AChildHasOurs) {
  const ChangedChild child([] { return true; });
  EXPECT_EQ(why_not_ours(child.pid), "");
  EXPECT_EQ(why_not_ours(::gettid()), "");
}

TEST(CallerRightsOfAnybody, WhoIsGoneHasNone) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  EXPECT_EQ(why_not_ours(child), kOtherRights);
  EXPECT_FALSE(is_administrator(child));
  EXPECT_THAT(lineage_of(child), testing::IsEmpty());
}

TEST_F(CallerRights, WhoHasGivenUpSomethingHasNotOurs) {
  const test::TempDir dir;
  struct Given {
    const char* what;
    std::function<bool()> change;
    const char* why;
  };
  for (const Given& given : std::initializer_list<Given>{
           {"group", [] { return ::setgid(12345) == 0; }, kOtherRights},
           {"user", [] { return ::setuid(12345) == 0 && ::prctl(PR_SET_DUMPABLE, 1) == 0; }, kOtherRights},
           {"group of files", [] { return ::setfsgid(12345) >= 0; }, kOtherRights},
           {"user of files", [] { return ::setfsuid(12345) >= 0; }, kOtherRights},
           {"groups",
            [] {
              return set_groups({7, 12345});
            },
            kOtherRights},
           {"a capability", [] { return drop_capability(CAP_NET_RAW); }, kOtherRights},
           {"a late capability", [] { return drop_capability(CAP_AUDIT_READ); }, kOtherRights},
           {"mounts", [] { return ::unshare(CLONE_NEWNS) == 0; }, kOtherFiles},
           {"the root", [&] { return ::chroot(dir.path().c_str()) == 0; }, kOtherFiles}}) {
    const ChangedChild child(given.change);
    if (!child.made) continue;  // this container lets nobody do that
    EXPECT_EQ(why_not_ours(child.pid), given.why) << given.what;
  }
}

TEST_F(CallerRights, AUserNamespaceIsItsOwn) {
  const ChangedChild child([] { return ::unshare(CLONE_NEWUSER) == 0; });
  if (!child.made) GTEST_SKIP() << "no user namespaces here";
  EXPECT_EQ(why_not_ours(child.pid), kOtherUsers);
  EXPECT_FALSE(is_administrator(child.pid));
}

// The order in which a process has its groups says nothing.
TEST_F(CallerRights, MoreRightsThanOursAreEnough) {
  const ChangedChild child([] {
    if (!set_groups({7, 12345})) return false;
    const ChangedChild parent([] { return set_groups({12345, 7}); });
    return parent.made && drop_capability(CAP_NET_RAW) && why_not_ours(parent.pid).empty();
  });
  EXPECT_TRUE(child.made);
}

TEST_F(CallerRights, AnAdministratorHasTheCapabilityHere) {
  const ChangedChild same([] { return true; });
  const ChangedChild without([] { return drop_capability(CAP_SYS_ADMIN); });
  const ChangedChild without_another([] { return drop_capability(CAP_SYS_BOOT); });
  const bool are_we = is_administrator(::gettid());
  EXPECT_EQ(is_administrator(same.pid), are_we);
  EXPECT_EQ(is_administrator(without_another.pid), are_we);
  ASSERT_TRUE(without.made);
  EXPECT_FALSE(is_administrator(without.pid));
}

TEST(CallerRightsOfAnybody, ALineageIsOfProcessesFromTheThreadsOwnOn) {
  const ChangedChild child([] { return true; });
  std::vector<pid_t> lineage = lineage_of(child.pid);
  ASSERT_FALSE(lineage.empty());
  EXPECT_EQ(lineage[0], child.pid);
  if (::getpid() > 1) {
    ASSERT_GE(lineage.size(), 2U);
    EXPECT_EQ(lineage[1], ::getpid());
  }
  if (::getppid() > 1) {
    ASSERT_GE(lineage.size(), 3U);
    EXPECT_EQ(lineage[2], ::getppid());
  }
  EXPECT_THAT(lineage, testing::Each(testing::Gt(1)));
  std::thread([&] { lineage = lineage_of(::gettid()); }).join();
  ASSERT_FALSE(lineage.empty());
  EXPECT_EQ(lineage.front(), ::getpid());
  EXPECT_THAT(lineage_of(1), testing::IsEmpty());
}

}  // namespace
}  // namespace porttape
