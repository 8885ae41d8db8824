#include "libport/supervise/program_files.hpp"

#include <array>
#include <cerrno>
#include <climits>
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
#include <utility>

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

ProgramFile from_folder(const std::string& folder, std::string path) {
  const auto place =
      std::make_shared<const UniqueFd>(::open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  return {.path = std::move(path), .folder = place};
}

// The whole name, to be compared: it may be longer than the kernel takes.
std::string whole_name(const ProgramFile& file) {
  if (!file.folder) return without_repeats(file.path);
  std::error_code error;
  const auto folder = std::filesystem::read_symlink(fmt::format("/proc/self/fd/{}", file.at()), error);
  return error ? std::string() : without_repeats(folder / file.path);
}

// The file by a name that a process has for its own files, from that process's folder in /proc.
ProgramFile in_proc(const std::string& folder, std::string_view rest) {
  if (rest.starts_with('/')) rest.remove_prefix(1);
  ProgramFile file = from_folder("/proc/" + folder, std::string(rest.empty() ? "." : rest));
  file.in_proc = true;
  return file;
}

// Nullopt: `name` is no name by which a process has its own files.
std::optional<ProgramFile> named_by_process(pid_t thread, const std::string& name) {
  constexpr std::array<std::string_view, 3> kStandard{"/dev/stdin", "/dev/stdout", "/dev/stderr"};
  for (std::size_t fd = 0; fd < kStandard.size(); ++fd) {
    if (name == kStandard.at(fd)) return in_proc(fmt::format("{}/fd", thread), std::to_string(fd));
  }
  if (const auto rest = below(name, "/dev/fd")) return in_proc(fmt::format("{}/fd", thread), *rest);
  if (const auto rest = below(name, "/proc/self")) return in_proc(std::to_string(process_of(thread)), *rest);
  if (const auto rest = below(name, "/proc/thread-self"))
    return in_proc(fmt::format("{}/task/{}", process_of(thread), thread), *rest);
  return std::nullopt;
}

// What the link leads to; nullopt: it is no link.
std::optional<ProgramFile> target_of(const ProgramFile& link) {
  std::string target(PATH_MAX, '\0');
  const ssize_t size = ::readlinkat(link.at(), link.path.c_str(), target.data(), target.size());
  if (size <= 0) return std::nullopt;
  target.resize(static_cast<std::size_t>(size));
  if (target.starts_with('/')) return ProgramFile{.path = std::move(target)};
  const std::size_t slash = link.path.rfind('/');
  if (slash == std::string::npos) return ProgramFile{.path = std::move(target), .folder = link.folder};
  const std::string folder = link.path.substr(0, slash + 1);
  return ProgramFile{.path = std::move(target),
                     .folder = std::make_shared<const UniqueFd>(
                         ::openat(link.at(), folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC))};
}

UniqueFd open_place(const ProgramFile& file, std::uint64_t resolve) {
  const open_how how{.flags = O_PATH | O_CLOEXEC, .mode = 0, .resolve = resolve};
  return UniqueFd(static_cast<int>(::syscall(SYS_openat2, file.at(), file.path.c_str(), &how, sizeof(how))));
}

}  // namespace

ProgramFile program_file(pid_t thread, const std::string& path, int folder) {
  if (path.starts_with('/')) return {.path = path};
  return from_folder(folder == AT_FDCWD ? fmt::format("/proc/{}/cwd", thread)
                                        : fmt::format("/proc/{}/fd/{}", thread, folder),
                     path);
}

ProgramFile own_file(pid_t thread, const ProgramFile& named) {
  constexpr int kMostLinks = 40;  // as many as the kernel follows
  ProgramFile file = named;
  for (int followed = 0; followed < kMostLinks; ++followed) {
    const std::string name = whole_name(file);
    if (std::optional<ProgramFile> own = named_by_process(thread, name)) return *std::move(own);
    if (name.starts_with("/proc/")) {
      if (followed > 0) break;
      file.in_proc = true;
      return file;
    }
    // A link may lead to such a name, which is the program's own then.
    std::optional<ProgramFile> target = target_of(file);
    if (!target) break;
    file = *std::move(target);
  }
  return named;
}

bool leads_through_process(const ProgramFile& file) {
  return !open_place(file, RESOLVE_NO_MAGICLINKS) && errno == ELOOP;
}

std::optional<TtyDevice> tty_device_at(const ProgramFile& file) {
  struct stat status {};
  return ::fstatat(file.at(), file.path.c_str(), &status, 0) == 0 ? tty_device_in(status) : std::nullopt;
}

QuickLook look_at_once(const ProgramFile& file) {
  if (file.folder && !*file.folder) return {};
  // Links to what a process has open are the program's own, which is another process here.
  const UniqueFd place = open_place(file, kResolveCached | RESOLVE_NO_MAGICLINKS);
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
