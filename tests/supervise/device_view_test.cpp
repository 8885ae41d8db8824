// A private /dev, each entered in a process of its own; as root, and as a user.

#include "libport/supervise/device_view.hpp"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <grp.h>
#include <iterator>
#include <linux/capability.h>
#include <pty.h>
#include <sched.h>
#include <string>
#include <string_view>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <system_error>
#include <termios.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

const PortIdentity kFound{.path = "/dev/ttyUSB93",
                          .vid = 0x0403,
                          .pid = 0x6001,
                          .serial = "PT0001",
                          .manufacturer = "FTDI",
                          .product = "FT232R"};
constexpr const char* kById = "/dev/serial/by-id/usb-FTDI_FT232R_PT0001-if00-port0";

// A pty whose slave everybody may open.
struct View {
  View() {
    std::array<char, 64> name{};
    int near = -1;
    int far = -1;
    if (::openpty(&near, &far, name.data(), nullptr, nullptr) != 0) std::abort();
    master.reset(near);
    slave.reset(far);
    ::fchmod(far, 0666);
    node = name.data();
  }
  UniqueFd master;
  UniqueFd slave;
  std::string node;
};

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

bool is_there(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0;
}

std::string error_at(const std::string& path) {
  const UniqueFd file(::open(path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  return file ? "opened" : errno_text(errno);
}

// What `work` says, in a process of its own; as another user where that can be.
std::string in_process(bool as_user, const std::function<std::string()>& work) {
  std::array<int, 2> pair{};
  if (::pipe(pair.data()) != 0) return "no pipe";
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(pair[0]);
    std::string text = "cannot be a user";
    if (!as_user || ::geteuid() != 0 ||
        (::setgroups(0, nullptr) == 0 && ::setresgid(54321, 54321, 54321) == 0 &&
         ::setresuid(54321, 54321, 54321) == 0)) {
      ::prctl(PR_SET_DUMPABLE, 1);  // as after an exec: else /proc/self is root's
      text = work();
    }
    (void)!::write(pair[1], text.data(), text.size());
    ::_exit(0);
  }
  ::close(pair[1]);
  std::string said;
  std::array<char, 4096> part{};
  for (ssize_t size = 0; (size = ::read(pair[0], part.data(), part.size())) > 0;)
    said.append(part.data(), static_cast<std::size_t>(size));
  ::close(pair[0]);
  ::waitpid(child, nullptr, 0);
  return said;
}

// What this machine refuses of what a view is made of; empty: nothing.
std::string forbidden_here(bool as_user) {
  return in_process(as_user, []() -> std::string {
    const std::string user = std::to_string(::geteuid());
    if (::unshare(CLONE_NEWNS) != 0) {
      if (::unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return "namespaces: " + errno_text(errno);
      std::ofstream("/proc/self/uid_map") << user << ' ' << user << " 1";
    }
    if (::mount("", "/", nullptr, MS_REC | MS_SLAVE, nullptr) != 0 ||
        ::mount("test", "/dev", "tmpfs", MS_NOSUID | MS_NODEV, nullptr) != 0)
      return "mounts: " + errno_text(errno);
    return {};
  });
}

class DeviceViewTest : public testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    if (const std::string forbidden = forbidden_here(GetParam()); !forbidden.empty())
      GTEST_SKIP() << forbidden;
  }
  std::string inside(const std::function<std::string()>& work, const PortIdentity& identity = kFound) {
    return in_process(GetParam(), [&] {
      const Result<void> entered = enter_device_view({{identity, view.node}});
      return entered ? work() : entered.error().message;
    });
  }
  View view;
};

INSTANTIATE_TEST_SUITE_P(As, DeviceViewTest, testing::Values(false, true),
                         [](const auto& as) { return as.param ? "User" : "Caller"; });

TEST_P(DeviceViewTest, ThePortIsThePtyByEachName) {
  for (const std::string path : {"/dev/ttyUSB93", kById}) {
    EXPECT_EQ(inside([&] {
                const UniqueFd port(::open(path.c_str(), O_RDWR | O_NOCTTY));
                if (!port) return errno_text(errno);
                struct termios raw {};
                ::tcgetattr(port.get(), &raw);
                ::cfmakeraw(&raw);
                ::tcsetattr(port.get(), TCSANOW, &raw);
                return std::string(::write(port.get(), "hello", 5) == 5 ? "written" : "not written");
              }),
              "written")
        << path;
    std::array<char, 16> got{};
    ASSERT_EQ(::read(view.master.get(), got.data(), got.size()), 5) << path;
    EXPECT_STREQ(got.data(), "hello");
  }
}

TEST_P(DeviceViewTest, KernelAndUdevTellOfIt) {
  EXPECT_EQ(inside([] { return text_of("/sys/class/tty/ttyUSB93/device/../../idVendor"); }), "0403\n");
  struct stat status {};
  ASSERT_EQ(::stat(view.node.c_str(), &status), 0);
  const std::string number =
      std::to_string(major(status.st_rdev)) + ':' + std::to_string(minor(status.st_rdev));
  EXPECT_EQ(inside([&] { return text_of("/sys/dev/char/" + number + "/dev"); }), number + '\n');
  EXPECT_THAT(inside([&] { return text_of("/run/udev/data/c" + number); }),
              HasSubstr("E:ID_VENDOR_ID=0403\n"));
  EXPECT_EQ(inside([] { return std::string(is_there("/run/udev/control") ? "there" : "not there"); }),
            "there");
}

TEST_P(DeviceViewTest, TheRestOfDevIsAsItWas) {
  for (const char* path : {"/dev/null", "/dev/zero", "/dev/ptmx"})
    EXPECT_EQ(inside([&] { return error_at(path); }), "opened") << path;
  EXPECT_EQ(inside([&] { return error_at(view.node); }), "opened");
  EXPECT_EQ(inside([] {
              const UniqueFd master(::posix_openpt(O_RDWR | O_NOCTTY));
              if (!master || ::grantpt(master.get()) != 0 || ::unlockpt(master.get()) != 0)
                return errno_text(errno);
              return error_at(::ptsname(master.get()));
            }),
            "opened");
  EXPECT_EQ(inside([] {
              const std::string name = "/dev/shm/porttape-view." + std::to_string(::getpid());
              const UniqueFd file(::open(name.c_str(), O_RDWR | O_CREAT, 0600));
              ::unlink(name.c_str());
              return std::string(file ? "made" : "not made");
            }),
            "made");
  // Without a controlling terminal, as everywhere.
  EXPECT_EQ(inside([] {
              ::setsid();
              return error_at("/dev/tty");
            }),
            errno_text(ENXIO));
  EXPECT_EQ(inside([] {
              ::setsid();
              const UniqueFd port(::open("/dev/ttyUSB93", O_RDWR));
              return error_at("/dev/tty");
            }),
            "opened");
}

TEST_P(DeviceViewTest, TheUserStaysWhoItIs) {
  const std::string who = in_process(GetParam(), [] { return std::to_string(::geteuid()); });
  EXPECT_EQ(inside([] { return std::to_string(::geteuid()); }), who);
  const auto capabilities = [] {
    const std::string status = text_of("/proc/self/status");
    return status.substr(status.find("CapInh"), status.find("CapBnd") - status.find("CapInh"));
  };
  EXPECT_EQ(inside(capabilities), in_process(GetParam(), capabilities));
}

TEST_P(DeviceViewTest, ItTakesThePlaceOfADeviceOfItsName) {
  if (!is_there("/dev/ttyS0")) GTEST_SKIP() << "this machine has no /dev/ttyS0";
  struct stat pty {};
  ASSERT_EQ(::stat(view.node.c_str(), &pty), 0);
  EXPECT_EQ(inside(
                [] {
                  struct stat status {};
                  ::stat("/dev/ttyS0", &status);
                  return std::to_string(status.st_rdev);
                },
                {.path = "/dev/ttyS0"}),
            std::to_string(pty.st_rdev));
}

// The device whose place it takes, and all that is hidden with it, is nowhere else.
TEST_P(DeviceViewTest, WhatIsHiddenIsToBeHadByNoOtherName) {
  const auto reached = [](const std::string& folder) {
    std::string all;
    std::error_code error;
    for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      struct stat status {};
      if (entry->is_symlink(error) || ::stat(entry->path().c_str(), &status) != 0) continue;
      const bool is_tty = S_ISCHR(status.st_mode) && major(status.st_rdev) == 4;
      if (is_tty) all += entry->path().string() + ' ';
    }
    return all;
  };
  EXPECT_EQ(inside([&] { return reached("/dev/.porttape"); }), "");
}

// Of a command that makes ptys, as a terminal emulator does.
TEST_P(DeviceViewTest, ANewPtyHasItsNameWhereTheSystemLetsUsMakeItsNode) {
  const std::string name = inside([] {
    int near = -1;
    int far = -1;
    std::array<char, 64> path{};
    if (::openpty(&near, &far, nullptr, nullptr, nullptr) != 0) return errno_text(errno);
    return std::string(::ttyname_r(far, path.data(), path.size()) == 0 ? path.data() : "none");
  });
  if (GetParam()) {
    EXPECT_THAT(name,
                testing::AnyOf(testing::StartsWith("/dev/pts/"), testing::StartsWith("/dev/.porttape/pts/")));
  } else if (!inside([] { return std::string(is_there("/dev/.porttape") ? "" : "own"); }).empty()) {
    EXPECT_THAT(name, testing::StartsWith("/dev/pts/"));
  }
}

TEST_P(DeviceViewTest, LinksOfTheDeviceThatWasThereAreGone) {
  const View first;
  EXPECT_EQ(
      in_process(GetParam(),
                 [&] {
                   PortIdentity other = kFound;
                   other.serial = "OTHER";
                   for (const DevicePort& port : {DevicePort{kFound, first.node}, {other, view.node}}) {
                     const Result<void> entered = enter_device_view({port});
                     if (!entered) return entered.error().message;
                   }
                   return std::string(is_there(kById) ? "old" : "no old") +
                          (is_there("/dev/serial/by-id/usb-FTDI_FT232R_OTHER-if00-port0") ? ", new" : "");
                 }),
      "no old, new");
}

TEST_P(DeviceViewTest, WhoStandsInDevStandsInTheNewOne) {
  EXPECT_EQ(in_process(GetParam(),
                       [&]() -> std::string {
                         if (::chdir("/dev") != 0) return errno_text(errno);
                         const Result<void> entered = enter_device_view({{kFound, view.node}});
                         return entered ? error_at("ttyUSB93") : entered.error().message;
                       }),
            "opened");
}

TEST_P(DeviceViewTest, TheLatencyTimerIsWhereProgramsLookForIt) {
  EXPECT_EQ(inside([] { return text_of("/sys/bus/usb-serial/devices/ttyUSB93/latency_timer"); }), "16\n");
}

TEST_P(DeviceViewTest, NothingOfItIsOnTheHost) {
  const std::string mounts = text_of("/proc/self/mountinfo");
  const bool had_udev = is_there("/run/udev");
  const bool had_serial = is_there("/dev/serial");
  EXPECT_EQ(inside([] { return std::string(is_there("/dev/ttyUSB93") ? "there" : ""); }), "there");
  EXPECT_FALSE(is_there("/dev/ttyUSB93"));
  EXPECT_FALSE(is_there("/dev/.porttape"));
  EXPECT_FALSE(is_there("/sys/class/tty/ttyUSB93"));
  EXPECT_EQ(is_there("/run/udev"), had_udev);
  EXPECT_EQ(is_there("/dev/serial"), had_serial);
  EXPECT_EQ(text_of("/proc/self/mountinfo"), mounts);
}

TEST_P(DeviceViewTest, OnceThePtyIsGoneTheNameIsDead) {
  EXPECT_EQ(in_process(GetParam(),
                       [] {
                         View own;
                         const Result<void> entered = enter_device_view({{kFound, own.node}});
                         if (!entered) return entered.error().message;
                         const std::string before = error_at("/dev/ttyUSB93");
                         own.slave.reset();
                         own.master.reset();
                         // A new one may get its number, and is not under its name.
                         const View next;
                         return before + ", " + error_at("/dev/ttyUSB93");
                       }),
            "opened, " + errno_text(EIO));
}

TEST(DeviceView, WhatForbidsItIsNamed) {
  const View view;
  const std::string said = in_process(true, [&]() -> std::string {
    // In a user namespace that may have none below, without rights there.
    const std::string user = std::to_string(::geteuid());
    if (::unshare(CLONE_NEWUSER) != 0) return "no namespace";
    std::ofstream("/proc/self/uid_map") << user << ' ' << user << " 1";
    std::ofstream limit("/proc/sys/user/max_user_namespaces");
    if (!(limit << 0 << std::flush)) return "no namespace";
    __user_cap_header_struct head{_LINUX_CAPABILITY_VERSION_3, 0};
    const std::array<__user_cap_data_struct, 2> none{};
    if (::syscall(SYS_capset, &head, none.data()) != 0) return "no namespace";
    const Result<void> can = can_enter_device_view({{kFound, view.node}});
    return can ? "entered" : can.error().message;
  });
  if (said == "no namespace") GTEST_SKIP() << "no user namespaces here";
  EXPECT_EQ(
      said,
      "no /dev of its own for the command: this system allows 0 user namespaces and no more: allow more by "
      "sysctl user.max_user_namespaces=N, or run as root");
}

TEST(DeviceView, ThePlaceOfSomethingElseIsRefused) {
  const View view;
  std::vector<std::string> others;
  for (const char* path :
       {"/dev/kmsg", "/dev/net", "/dev/tty1", "/dev/loop0", "/dev/vda", "/dev/mqueue", "/dev/core"}) {
    if (is_there(path)) others.emplace_back(path);
  }
  if (others.empty()) GTEST_SKIP() << "this machine has nothing of these in /dev";
  for (const std::string& path : others) {
    const auto said = in_process(false, [&] {
      return enter_device_view({{{.path = path}, view.node}}).error().message;
    });
    EXPECT_EQ(said, "port '" + path +
                        "' is something else than a serial port on this machine; give another name by --as");
  }
}

// The calls of which the view is made, each refused once.
class RefusedViewTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string forbidden = forbidden_here(false); !forbidden.empty()) GTEST_SKIP() << forbidden;
  }
  [[nodiscard]] std::string without(const std::vector<test::RefusedCall>& calls, bool as_user = false) const {
    return in_process(as_user, [&]() -> std::string {
      if (!test::refuse(calls)) return "not refused";
      const Result<void> entered = enter_device_view({{kFound, view.node}});
      return entered ? "entered" : entered.error().message;
    });
  }
  static test::RefusedCall refused_mount(unsigned long flags, int error) {
    const auto all = static_cast<std::uint32_t>(flags);
    return {SYS_mount, error, test::RefusedCall::Argument{3, 0xffffffff, all}};
  }
  View view;
};

const std::string kNoView = "no /dev of its own for the command: ";
constexpr const char* kMountsForbidden =
    ": Operation not permitted; what runs this forbids mounts (a container, a security module): allow them "
    "there, or run as root with CAP_SYS_ADMIN";

TEST_F(RefusedViewTest, EachStepThatFailsIsNamed) {
  EXPECT_EQ(without({refused_mount(MS_REC | MS_SLAVE, ENOMEM)}), kNoView + "/: Cannot allocate memory");
  EXPECT_EQ(without({refused_mount(MS_NOSUID, ENOMEM)}),
            kNoView + "a file system in memory on /dev: Cannot allocate memory");
  EXPECT_EQ(without({refused_mount(MS_BIND, ENOMEM)}), kNoView + "/dev/ttyUSB93: Cannot allocate memory");
  struct stat status {};
  if (::lstat("/dev/ptmx", &status) == 0 && S_ISCHR(status.st_mode)) {
    EXPECT_EQ(without({{SYS_open_tree, ENOSYS}}), kNoView + "open_tree /dev: Function not implemented");
    // Who may not make the node of new ptys takes the folder that it was in.
    EXPECT_EQ(without({{SYS_mknodat, EPERM}, {SYS_move_mount, ENOSYS}}),
              kNoView + "/dev/.porttape: Function not implemented");
  }
#ifdef SYS_symlink
  EXPECT_THAT(without({{SYS_symlink, ENOSPC}}),
              testing::AllOf(testing::StartsWith(kNoView), testing::EndsWith(": No space left on device")));
  EXPECT_THAT(without({{SYS_unlink, EIO}}), testing::AllOf(testing::StartsWith(kNoView + "/dev/"),
                                                           testing::EndsWith(": Input/output error")));
  EXPECT_THAT(without({{SYS_mkdir, ENOSPC}}),
              testing::AllOf(testing::StartsWith(kNoView), testing::EndsWith(": No space left on device")));
#endif
  EXPECT_THAT(without({test::refused_open(O_CREAT | O_EXCL, ENOSPC)}),
              testing::AllOf(testing::StartsWith(kNoView), testing::EndsWith(": No space left on device")));
  EXPECT_EQ(without({test::refused_open(O_PATH, ENFILE)}),
            kNoView + view.node + ": Too many open files in system");
  EXPECT_EQ(without({test::refused_open(O_DIRECTORY, ENFILE)}),
            kNoView + "/dev: Too many open files in system");
}

TEST_F(RefusedViewTest, WhatForbidsMountsIsSaid) {
  EXPECT_EQ(without({{SYS_mount, EPERM}}), kNoView + "/" + kMountsForbidden);
  EXPECT_THAT(without({{SYS_mount, EACCES}}), HasSubstr("forbids mounts"));
}

TEST_F(RefusedViewTest, WhatForbidsNamespacesIsSaid) {
  if (text_of("/proc/sys/kernel/unprivileged_userns_clone") == "0\n" ||
      text_of("/proc/sys/user/max_user_namespaces") == "0\n")
    GTEST_SKIP() << "this system forbids them by a setting, which is what is said";
  std::string most = text_of("/proc/sys/user/max_user_namespaces");
  most = most.empty() ? "so many" : most.substr(0, most.find('\n'));
  for (const int error : {ENOSPC, EUSERS}) {
    EXPECT_EQ(without({{SYS_unshare, error}}),
              kNoView + "this system allows " + most +
                  " user namespaces and no more: allow more by sysctl user.max_user_namespaces=N, or run as "
                  "root");
  }
  for (const int error : {EINVAL, ENOSYS}) {
    EXPECT_EQ(without({{SYS_unshare, error}}), kNoView + "this kernel has no user namespaces: run as root");
  }
  if (text_of("/proc/sys/kernel/apparmor_restrict_unprivileged_userns") == "1\n") return;
  EXPECT_EQ(without({{SYS_unshare, EPERM}}),
            kNoView +
                "unshare: Operation not permitted; what runs this forbids namespaces (a container, a "
                "service's rules, a chroot): allow them there, or run as root with CAP_SYS_ADMIN");
}

TEST_F(RefusedViewTest, AUserWhoseNamespaceCannotBeMadeIsTold) {
  if (const std::string forbidden = forbidden_here(true); !forbidden.empty()) GTEST_SKIP() << forbidden;
  EXPECT_EQ(without({}, true), "entered");
  EXPECT_EQ(without({test::refused_open(O_WRONLY | O_CLOEXEC, ENOENT)}, true),
            kNoView + "/proc/self/setgroups: No such file or directory; mount /proc first");
  EXPECT_EQ(without({test::refused_open(O_WRONLY | O_CLOEXEC, EIO)}, true),
            kNoView + "/proc/self/setgroups: Input/output error");
  EXPECT_EQ(without({{SYS_capset, EINVAL}}, true), kNoView + "capset: Invalid argument");
}

// What cannot be mounted again is missing, and nothing stands in its place.
TEST_F(RefusedViewTest, AFolderThatCannotBeShownIsMissing) {
  const std::string said = in_process(false, [&]() -> std::string {
    if (!test::refuse({refused_mount(MS_BIND | MS_REC, EINVAL)})) return "not refused";
    const Result<void> entered = enter_device_view({{kFound, view.node}});
    if (!entered) return entered.error().message;
    return std::string(is_there("/dev/pts") ? "there" : "missing") +
           (is_there("/dev/null") ? ", null there" : ", null missing");
  });
  EXPECT_EQ(said, "missing, null there");
}

TEST_F(RefusedViewTest, LinksAndTheFoldersModeAreAsTheyWere) {
  struct stat before {};
  ASSERT_EQ(::stat("/dev", &before), 0);
  const std::string said = in_process(false, [&]() -> std::string {
    ::umask(077);
    const Result<void> entered = enter_device_view({{kFound, view.node}});
    if (!entered) return entered.error().message;
    struct stat status {};
    if (::stat("/dev", &status) != 0 || (status.st_mode & 07777) != (before.st_mode & 07777)) return "a mode";
    if (::stat("/dev/serial", &status) != 0 || (status.st_mode & 07777) != 0755) return "a new folder's mode";
    if (::umask(0) != 077) return "the mask";
    std::array<char, 64> target{};
    if (!is_there("/dev/fd")) return "as it was";
    const ssize_t size = ::readlink("/dev/fd", target.data(), target.size());
    return size > 0 && std::string_view(target.data(), static_cast<std::size_t>(size)) == "/proc/self/fd"
               ? "as it was"
               : "a link";
  });
  EXPECT_EQ(said, "as it was");
}

TEST_F(RefusedViewTest, WhetherItCanBeIsAskedOfAProcess) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  const auto asked = [&](const std::vector<test::RefusedCall>& calls) {
    return in_process(false, [&]() -> std::string {
      if (!test::refuse(calls)) return "not refused";
      const Result<void> can = can_enter_device_view({{kFound, view.node}});
      return can ? "can" : can.error().message;
    });
  };
  EXPECT_EQ(asked({}), "can");
  EXPECT_EQ(asked({{SYS_pipe2, EMFILE}}), "a pipe: Too many open files");
  EXPECT_EQ(asked({{SYS_clone, EAGAIN}}), "a process: Resource temporarily unavailable");
  EXPECT_EQ(asked({{SYS_mount, ENOMEM}}), kNoView + "/: Cannot allocate memory");
  EXPECT_FALSE(is_there("/dev/ttyUSB93"));
}

TEST(DeviceView, APortWhoseNodeIsGoneIsNamed) {
  if (const std::string forbidden = forbidden_here(false); !forbidden.empty()) GTEST_SKIP() << forbidden;
  EXPECT_EQ(in_process(false,
                       [] {
                         const Result<void> entered = enter_device_view({{kFound, "/dev/no-such-node"}});
                         return entered ? std::string("entered") : entered.error().message;
                       }),
            kNoView + "/dev/no-such-node: No such file or directory");
}

TEST(DeviceView, APortThatCannotBeIsRefused) {
  EXPECT_THAT(in_process(false,
                         [] {
                           return enter_device_view({{{.path = "/dev/../x"}, "/dev/null"}}).error().message;
                         }),
              HasSubstr("begins with '.'"));
}

}  // namespace
}  // namespace porttape
