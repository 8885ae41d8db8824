#include "libport/supervise/private_mounts.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/capability.h>
#include <sched.h>
#include <string_view>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

struct CapabilitySets {
  std::uint64_t effective = 0;
  std::uint64_t permitted = 0;
};

CapabilitySets capabilities() {
  __user_cap_header_struct head{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, 2> halves{};
  if (::syscall(SYS_capget, &head, halves.data()) != 0) return {};
  return {halves[0].effective | std::uint64_t{halves[1].effective} << 32U,
          halves[0].permitted | std::uint64_t{halves[1].permitted} << 32U};
}

bool set_capabilities(std::uint64_t wanted) {
  __user_cap_header_struct head{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, 2> halves{};
  halves[0].effective = halves[0].permitted = static_cast<std::uint32_t>(wanted);
  halves[1].effective = halves[1].permitted = static_cast<std::uint32_t>(wanted >> 32U);
  return ::syscall(SYS_capset, &head, halves.data()) == 0;
}

// The first line of a file of /proc/sys; empty where this kernel has no such.
std::string system_setting(const char* path) {
  const UniqueFd file(::open(path, O_RDONLY | O_CLOEXEC));
  std::array<char, 64> text{};
  const ssize_t size = file ? ::read(file.get(), text.data(), text.size()) : -1;
  const std::string_view all(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  return std::string(all.substr(0, all.find('\n')));
}

constexpr const char* kAppArmorSetting = "/proc/sys/kernel/apparmor_restrict_unprivileged_userns";

std::string apparmor_reason() {
  return "AppArmor forbids user namespaces to programs without a profile: allow them by sysctl "
         "kernel.apparmor_restrict_unprivileged_userns=0, or run as root";
}

// Why there is no user namespace.
std::string namespace_reason(int error) {
  if (system_setting("/proc/sys/kernel/unprivileged_userns_clone") == "0") {
    return "this system forbids user namespaces: allow them by sysctl kernel.unprivileged_userns_clone=1, or "
           "run as root";
  }
  if (const std::string most = system_setting("/proc/sys/user/max_user_namespaces");
      error == ENOSPC || error == EUSERS || most == "0") {
    return fmt::format(
        "this system allows {} user namespaces and no more: allow more by sysctl user.max_user_namespaces=N, "
        "or run as root",
        most.empty() ? "so many" : most);
  }
  if (error == EINVAL || error == ENOSYS) return "this kernel has no user namespaces: run as root";
  if (system_setting(kAppArmorSetting) == "1") return apparmor_reason();
  return fmt::format(
      "unshare: {}; what runs this forbids namespaces (a container, a service's rules, a chroot): allow them "
      "there, or run as root with CAP_SYS_ADMIN",
      errno_text(error));
}

Error without_view(const std::string& why) {
  return make_error(Errc::io, "no /dev of its own for the command: " + why);
}

Result<void> write_map(const char* path, const std::string& text) {
  const UniqueFd file(::open(path, O_WRONLY | O_CLOEXEC));
  if (file && ::write(file.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size())) return {};
  const int error = errno;
  return without_view(
      fmt::format("{}: {}{}", path, errno_text(error), error == ENOENT ? "; mount /proc first" : ""));
}

// In which this user is who it was.
Result<void> enter_user_namespace() {
  const uid_t user = ::geteuid();
  const gid_t group = ::getegid();
  if (::unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return without_view(namespace_reason(errno));
  if (Result<void> done = write_map("/proc/self/setgroups", "deny"); !done) return done;
  if (Result<void> done = write_map("/proc/self/uid_map", fmt::format("{} {} 1", user, user)); !done)
    return done;
  return write_map("/proc/self/gid_map", fmt::format("{} {} 1", group, group));
}

}  // namespace

Result<PrivateMounts> PrivateMounts::enter() {
  PrivateMounts made;
  made.before_ = capabilities().permitted;
  if (::unshare(CLONE_NEWNS) != 0) {
    if (Result<void> entered = enter_user_namespace(); !entered) return entered.error();
    made.in_user_namespace_ = true;
  }
  if (::mount("", "/", nullptr, MS_REC | MS_SLAVE, nullptr) != 0) return made.refused("/", errno);
  return made;
}

Error PrivateMounts::refused(const std::string& what, int error_number) const {
  const bool forbidden = error_number == EPERM || error_number == EACCES;
  if (forbidden && in_user_namespace_ && system_setting(kAppArmorSetting) == "1")
    return without_view(apparmor_reason());
  return without_view(fmt::format("{}: {}{}", what, errno_text(error_number),
                                  forbidden ? "; what runs this forbids mounts (a container, a security "
                                              "module): allow them there, or run as root with CAP_SYS_ADMIN"
                                            : ""));
}

// One who is root gets at an exec what the bounding set leaves.
Result<void> PrivateMounts::drop_gained() const {
  if (!in_user_namespace_) return {};
  for (unsigned number = 0; number < 64; ++number) {
    if ((before_ >> number & 1U) == 0) (void)::prctl(PR_CAPBSET_DROP, number, 0, 0, 0);
  }
  if (!set_capabilities(capabilities().permitted & before_))
    return without_view("capset: " + errno_text(errno));
  return {};
}

}  // namespace porttape
