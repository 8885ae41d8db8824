#include "libport/supervise/program_files.hpp"

#include <algorithm>
#include <array>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

#include "libport/supervise/pending_signals.hpp"

namespace porttape {
namespace {

// What is behind `prefix`, where the path is that or lies below it.
std::optional<std::string_view> below(std::string_view path, std::string_view prefix) {
  if (!path.starts_with(prefix)) return std::nullopt;
  path.remove_prefix(prefix.size());
  return path.empty() || path.front() == '/' ? std::optional(path) : std::nullopt;
}

bool is_same_file(const std::string& one, const std::string& other) {
  struct stat first {};
  struct stat second {};
  if (::stat(one.c_str(), &first) != 0 || ::stat(other.c_str(), &second) != 0)
    return true;  // not to be known
  return first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

// Of a line of /proc/PID/status, all numbers.
std::vector<unsigned long> numbers_of(pid_t thread, std::string_view key) {
  std::ifstream status(fmt::format("/proc/{}/status", thread));
  std::vector<unsigned long> numbers;
  for (std::string line; std::getline(status, line);) {
    if (!line.starts_with(key)) continue;
    std::istringstream text(line.substr(key.size()));
    for (unsigned long number = 0; text >> number;) numbers.push_back(number);
    break;
  }
  return numbers;
}

// The one that counts for files is the last of four.
bool has_id(const std::vector<unsigned long>& ids, unsigned long ours) {
  return ids.size() != 4 || ids.back() == ours;
}

bool has_groups(std::vector<unsigned long> groups) {
  std::vector<gid_t> ours(static_cast<std::size_t>(std::max(::getgroups(0, nullptr), 0)));
  if (::getgroups(static_cast<int>(ours.size()), ours.data()) < 0) return true;
  std::ranges::sort(groups);
  std::ranges::sort(ours);
  return std::ranges::equal(groups, ours);
}

}  // namespace

std::string path_here(pid_t thread, const std::string& path, int folder) {
  if (!path.starts_with('/')) {
    return folder == AT_FDCWD ? fmt::format("/proc/{}/cwd/{}", thread, path)
                              : fmt::format("/proc/{}/fd/{}/{}", thread, folder, path);
  }
  constexpr std::array<std::string_view, 3> kStandard{"/dev/stdin", "/dev/stdout", "/dev/stderr"};
  for (std::size_t fd = 0; fd < kStandard.size(); ++fd) {
    if (path == kStandard.at(fd)) return fmt::format("/proc/{}/fd/{}", thread, fd);
  }
  if (const auto rest = below(path, "/dev/fd")) return fmt::format("/proc/{}/fd{}", thread, *rest);
  if (const auto rest = below(path, "/proc/self"))
    return fmt::format("/proc/{}{}", process_of(thread), *rest);
  if (const auto rest = below(path, "/proc/thread-self"))
    return fmt::format("/proc/{}/task/{}{}", process_of(thread), thread, *rest);
  return path;
}

std::string why_not_ours(pid_t thread) {
  const bool has_rights = has_id(numbers_of(thread, "Uid:"), ::geteuid()) &&
                          has_id(numbers_of(thread, "Gid:"), ::getegid()) &&
                          has_groups(numbers_of(thread, "Groups:"));
  if (!has_rights) return "it has the rights of another user";
  const std::string folder = fmt::format("/proc/{}/", thread);
  if (!is_same_file(folder + "ns/mnt", "/proc/self/ns/mnt") ||
      !is_same_file(folder + "root", "/proc/self/root"))
    return "the files that it sees are others";
  return {};
}

bool gets_terminal(pid_t thread) {
  std::ifstream file(fmt::format("/proc/{}/stat", thread));
  std::string text;
  std::getline(file, text);
  const std::size_t name_end = text.rfind(')');  // a name may have one, too
  if (name_end == std::string::npos) return false;
  std::istringstream behind(text.substr(name_end + 1));
  char state = '\0';
  long parent = 0;
  long group = 0;
  long session = 0;
  long terminal = 0;
  if (!(behind >> state >> parent >> group >> session >> terminal)) return false;
  return terminal == 0 && session == process_of(thread);
}

}  // namespace porttape
