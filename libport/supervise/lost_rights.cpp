#include "libport/supervise/lost_rights.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <optional>
#include <pwd.h>
#include <string_view>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/xattr.h>
#include <unistd.h>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

bool is_program(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode) && ::access(path.c_str(), X_OK) == 0;
}

std::optional<std::string> program_file(const std::string& command) {
  if (command.find('/') != std::string::npos)
    return is_program(command) ? std::optional(command) : std::nullopt;
  const char* const path = std::getenv("PATH");
  std::string_view rest = path != nullptr ? path : "/bin:/usr/bin";
  for (;;) {
    const std::size_t colon = rest.find(':');
    const std::string folder(rest.substr(0, colon));
    std::string file = folder.empty() ? command : folder + '/' + command;
    if (is_program(file)) return file;
    if (colon == std::string_view::npos) return std::nullopt;
    rest.remove_prefix(colon + 1);
  }
}

// Of those the interpreter's rights count alone.
bool is_script(const std::string& file) {
  const UniqueFd opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  std::array<char, 2> begin{};
  return opened && ::read(opened.get(), begin.data(), begin.size()) == 2 && begin[0] == '#' &&
         begin[1] == '!';
}

std::string user_name(uid_t user) {
  const passwd* const known = ::getpwuid(user);
  return known != nullptr ? known->pw_name : std::to_string(user);
}

std::string group_name(gid_t group) {
  const ::group* const known = ::getgrgid(group);
  return known != nullptr ? known->gr_name : std::to_string(group);
}

bool in_group(gid_t group) {
  if (group == ::getegid()) return true;
  std::vector<gid_t> all(static_cast<std::size_t>(std::max(::getgroups(0, nullptr), 0)));
  const int count = ::getgroups(static_cast<int>(all.size()), all.data());
  if (count < 0) return false;
  all.resize(static_cast<std::size_t>(count));
  return std::ranges::find(all, group) != all.end();
}

}  // namespace

std::string lost_rights(const std::string& command) {
  if (::geteuid() == 0) return {};
  const std::optional<std::string> file = program_file(command);
  struct stat status {};
  struct statvfs system {};
  if (!file || ::stat(file->c_str(), &status) != 0) return {};
  if (::statvfs(file->c_str(), &system) == 0 && (system.f_flag & ST_NOSUID) != 0) return {};
  std::string rights;
  std::string remedy;
  if ((status.st_mode & S_ISUID) != 0 && status.st_uid != ::geteuid()) {
    rights = fmt::format("setuid {}", in_quotes(user_name(status.st_uid)));
    remedy = fmt::format("as {}", in_quotes(user_name(status.st_uid)));
  } else if ((status.st_mode & S_ISGID) != 0 && (status.st_mode & S_IXGRP) != 0 && !in_group(status.st_gid)) {
    rights = fmt::format("setgid {}", in_quotes(group_name(status.st_gid)));
    remedy = fmt::format("in the group {}, or as root", in_quotes(group_name(status.st_gid)));
  } else if (::getxattr(file->c_str(), "security.capability", nullptr, 0) > 0) {
    rights = "of file capabilities";
    remedy = "as root";
  }
  if (rights.empty() || is_script(*file)) return {};
  return fmt::format("{} is {}, and under a supervisor runs without those rights: run porttape {}",
                     in_quotes(*file), rights, remedy);
}

}  // namespace porttape
