#include "libport/tty/device_access.hpp"

#include <algorithm>
#include <cstdio>
#include <fmt/format.h>
#include <grp.h>
#include <memory>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

using File = std::unique_ptr<FILE, int (*)(FILE*)>;

// By the system's own files alone: a name service may take long to answer, and this is on the loop.
std::string user_name(uid_t id) {
  const File file(std::fopen("/etc/passwd", "re"), &std::fclose);
  while (const passwd* const entry = file ? ::fgetpwent(file.get()) : nullptr) {
    if (entry->pw_uid == id) return entry->pw_name;
  }
  return std::to_string(id);
}

bool is_member_of(gid_t group) {
  if (::getegid() == group) return true;
  std::vector<gid_t> all(static_cast<std::size_t>(std::max(::getgroups(0, nullptr), 0)));
  const int count = ::getgroups(static_cast<int>(all.size()), all.data());
  return std::find(all.begin(), all.begin() + std::max(count, 0), group) != all.begin() + std::max(count, 0);
}

}  // namespace

DeviceAccess device_access(const std::string& device, int mode) {
  DeviceAccess access;
  access.device = device;
  access.user = user_name(::geteuid());
  struct stat status {};
  if (::stat(device.c_str(), &status) != 0) return access;
  access.owner = user_name(status.st_uid);
  const unsigned wanted = ((mode & R_OK) != 0 ? S_IRGRP : 0U) | ((mode & W_OK) != 0 ? S_IWGRP : 0U);
  access.group_may = (status.st_mode & wanted) == wanted;
  access.is_member = is_member_of(status.st_gid);
  access.group = std::to_string(status.st_gid);
  const File file(std::fopen("/etc/group", "re"), &std::fclose);
  while (const group* const entry = file ? ::fgetgrent(file.get()) : nullptr) {
    if (entry->gr_gid != status.st_gid) continue;
    access.group = entry->gr_name;
    for (char** member = entry->gr_mem; *member != nullptr; ++member)
      access.is_listed = access.is_listed || access.user == *member;
  }
  return access;
}

std::string access_advice(const DeviceAccess& access) {
  const std::string of_group = fmt::format("it belongs to group {}", in_quotes(access.group));
  const std::string path = shell_word(access.device);
  if (access.owner.empty()) return "see ls -l " + path;
  if (access.owner == access.user) return fmt::format("it is yours and closed to you: chmod u+rw {}", path);
  // Nobody should be of root's group, and what the group may not do needs other rights.
  if (!access.group_may || access.group == "root") {
    return fmt::format("only {} may open it; make it yours until it is plugged in again: sudo chown {} {}",
                       in_quotes(access.owner), shell_word(access.user), path);
  }
  if (access.is_member) return of_group + ", which may open it, and so are you; see getfacl " + path;
  if (access.is_listed) return of_group + ", to which you have been added: log in again";
  return fmt::format("{}; add yourself: sudo usermod -aG {} {}, then log in again", of_group,
                     shell_word(access.group), shell_word(access.user));
}

}  // namespace porttape
