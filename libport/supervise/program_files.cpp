#include "libport/supervise/program_files.hpp"

#include <array>
#include <cerrno>
#include <cstdint>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <linux/openat2.h>
#include <optional>
#include <sstream>
#include <string_view>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <system_error>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"
#include "libport/supervise/pending_signals.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kResolveCached = 0x20;  // RESOLVE_CACHED (Linux 5.12), which older headers lack

// What is behind `prefix`, where the path is that or lies below it.
std::optional<std::string_view> below(std::string_view path, std::string_view prefix) {
  if (!path.starts_with(prefix)) return std::nullopt;
  path.remove_prefix(prefix.size());
  return path.empty() || path.front() == '/' ? std::optional(path) : std::nullopt;
}

// Without slashes that are repeated, and without `.` as a part.
std::string without_repeats(const std::filesystem::path& path) {
  std::filesystem::path made;
  for (const std::filesystem::path& part : path) {
    if (part != ".") made /= part;
  }
  return made.native();
}

// The place in /proc of a folder that a program names files from.
std::string folder_here(pid_t thread, int folder) {
  return folder == AT_FDCWD ? fmt::format("/proc/{}/cwd", thread)
                            : fmt::format("/proc/{}/fd/{}", thread, folder);
}

// As the program names it, from `/` on or from its folder's place in /proc.
std::string absolute_here(pid_t thread, const std::string& named, int folder) {
  std::string path = without_repeats(named);
  if (path.starts_with('/')) return path;
  const std::string from = folder_here(thread, folder);
  std::error_code error;
  // Below it there may be the links by which a process names itself.
  const std::string place = std::filesystem::read_symlink(from, error).native();
  if (error || (place != "/proc" && place != "/dev" && place != "/")) return from + "/" + path;
  return (place == "/" ? "" : place) + "/" + path;
}

// The names by which a process has its own files, as these are called here; nothing for another name.
std::optional<std::string> own_names_here(pid_t thread, const std::string& path) {
  constexpr std::array<std::string_view, 3> kStandard{"/dev/stdin", "/dev/stdout", "/dev/stderr"};
  for (std::size_t fd = 0; fd < kStandard.size(); ++fd) {
    if (path == kStandard.at(fd)) return fmt::format("/proc/{}/fd/{}", thread, fd);
  }
  if (const auto rest = below(path, "/dev/fd")) return fmt::format("/proc/{}/fd{}", thread, *rest);
  if (const auto rest = below(path, "/proc/self"))
    return fmt::format("/proc/{}{}", process_of(thread), *rest);
  if (const auto rest = below(path, "/proc/thread-self"))
    return fmt::format("/proc/{}/task/{}{}", process_of(thread), thread, *rest);
  return std::nullopt;
}

}  // namespace

std::string path_here(pid_t thread, const std::string& named, int folder) {
  constexpr int kMostLinks = 40;  // as many as the kernel follows
  const std::string here = absolute_here(thread, named, folder);
  std::string path = here;
  for (int followed = 0; followed < kMostLinks; ++followed) {
    if (const auto own = own_names_here(thread, path)) return *own;
    if (path.starts_with("/proc/")) break;
    // A link may lead to such a name, which is the program's own then.
    std::error_code error;
    const std::filesystem::path target = std::filesystem::read_symlink(path, error);
    if (error) break;
    path = without_repeats(std::filesystem::path(path).parent_path() / target);
  }
  return here;
}

QuickLook look_at_once(pid_t thread, const std::string& path, int folder) {
  const bool relative = !path.starts_with('/');
  const std::string from = folder_here(thread, folder);
  const UniqueFd begin(relative ? ::open(from.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC) : -1);
  if (relative && !begin) return {};
  // Links to what a process has open are the program's own, which is another process here.
  const open_how how{
      .flags = O_PATH | O_CLOEXEC, .mode = 0, .resolve = kResolveCached | RESOLVE_NO_MAGICLINKS};
  const UniqueFd place(static_cast<int>(
      ::syscall(SYS_openat2, relative ? begin.get() : AT_FDCWD, path.c_str(), &how, sizeof(how))));
  if (!place) return {.known = errno == ENOENT || errno == ENOTDIR || errno == EACCES};
  struct statx seen {};
  if (::statx(place.get(), "", AT_EMPTY_PATH | AT_STATX_DONT_SYNC, STATX_TYPE, &seen) != 0) return {};
  struct stat status {};
  status.st_mode = seen.stx_mode;
  status.st_rdev = makedev(seen.stx_rdev_major, seen.stx_rdev_minor);
  status.st_dev = makedev(seen.stx_dev_major, seen.stx_dev_minor);
  return {.known = true, .device = tty_device_in(status)};
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
