#include "libport/supervise/private_folders.hpp"

#include <cerrno>
#include <climits>
#include <dirent.h>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <string_view>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <system_error>
#include <unistd.h>
#include <vector>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

// Of <linux/mount.h>, which is not to be mixed with <sys/mount.h>.
constexpr unsigned kCloneTree = 1;       // OPEN_TREE_CLONE
constexpr unsigned kRecursive = 0x8000;  // AT_RECURSIVE
constexpr unsigned kEmptyFrom = 4;       // MOVE_MOUNT_F_EMPTY_PATH

std::string parent_folder(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == 0 || slash == std::string::npos ? "/" : path.substr(0, slash);
}

bool make_empty_file(const std::string& path) {
  return UniqueFd(::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644)).get() >= 0;
}

// One entry of the folder that `old` is, again as `path`.
void copy_entry(int old, const char* name, const std::string& path) {
  struct stat status {};
  if (::fstatat(old, name, &status, AT_SYMLINK_NOFOLLOW) != 0) return;
  if (S_ISLNK(status.st_mode)) {
    std::string target(PATH_MAX, '\0');
    const ssize_t size = ::readlinkat(old, name, target.data(), target.size());
    if (size <= 0) return;
    target.resize(static_cast<std::size_t>(size));
    (void)::symlink(target.c_str(), path.c_str());
    return;
  }
  // By a descriptor, since the folder itself is covered by now.
  const std::string source = fmt::format("/proc/self/fd/{}/{}", old, name);
  const bool folder = S_ISDIR(status.st_mode);
  if (folder ? ::mkdir(path.c_str(), 0755) != 0 : !make_empty_file(path)) return;
  if (::mount(source.c_str(), path.c_str(), nullptr, MS_BIND | (folder ? MS_REC : 0), nullptr) == 0) return;
  (void)(folder ? ::rmdir(path.c_str()) : ::unlink(path.c_str()));
}

}  // namespace

Result<void> PrivateFolders::own(const std::string& folder) {
  if (owned_.contains(folder)) return {};
  struct stat status {};
  if (::stat(folder.c_str(), &status) == 0) {
    if (!S_ISDIR(status.st_mode)) return mounts_.refused(folder, ENOTDIR);
    return copy(folder);
  }
  const int error = errno;
  if (error != ENOENT || folder == "/" || parent_folder(folder) == "/") return mounts_.refused(folder, error);
  if (Result<void> above = own(parent_folder(folder)); !above) return above;
  if (::mkdir(folder.c_str(), 0755) != 0) return mounts_.refused(folder, errno);
  owned_.insert(folder);
  return {};
}

Result<void> PrivateFolders::copy(const std::string& folder) {
  const UniqueFd old(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  struct stat status {};
  if (!old || ::fstat(old.get(), &status) != 0) return mounts_.refused(folder, errno);
  const std::string options = fmt::format("mode={:o}", status.st_mode & 07777U);
  const unsigned long devices = folder == "/dev" ? 0 : MS_NODEV;
  if (::mount("porttape", folder.c_str(), "tmpfs", MS_NOSUID | devices, options.c_str()) != 0)
    return mounts_.refused("a file system in memory on " + folder, errno);
  owned_.insert(folder);
  const std::unique_ptr<DIR, int (*)(DIR*)> entries(::fdopendir(::dup(old.get())), &::closedir);
  if (!entries) return mounts_.refused(folder, errno);
  while (const dirent* const entry = ::readdir(entries.get())) {
    const std::string_view name = entry->d_name;
    if (name != "." && name != "..") copy_entry(old.get(), entry->d_name, folder + '/' + entry->d_name);
  }
  return {};
}

// Takes away what was copied.
Result<void> PrivateFolders::free_name(const std::string& path) {
  if (Result<void> owned = own(parent_folder(path)); !owned) return owned;
  (void)::umount2(path.c_str(), MNT_DETACH | UMOUNT_NOFOLLOW);
  if (::unlink(path.c_str()) == 0 || errno == ENOENT) return {};
  return mounts_.refused(path, errno);
}

Result<void> PrivateFolders::put_file(const std::string& path, const std::string& text) {
  if (Result<void> free = free_name(path); !free) return free;
  const UniqueFd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (file && ::write(file.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size())) return {};
  return mounts_.refused(path, errno);
}

Result<void> PrivateFolders::put_link(const std::string& path, const std::string& target) {
  if (Result<void> free = free_name(path); !free) return free;
  return ::symlink(target.c_str(), path.c_str()) == 0 ? Result<void>() : mounts_.refused(path, errno);
}

Result<void> PrivateFolders::drop_links(const std::string& folder, const std::string& name) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_directory(folder, error)) return {};
  if (Result<void> owned = own(folder); !owned) return owned;
  std::vector<fs::path> found;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (fs::read_symlink(entry->path(), error).filename() == name) found.push_back(entry->path());
    error.clear();  // of what is no link
  }
  for (const fs::path& link : found) {
    if (::unlink(link.c_str()) != 0) return mounts_.refused(link.string(), errno);
  }
  return {};
}

Result<void> PrivateFolders::put_mount(const std::string& path, const std::string& source) {
  if (Result<void> free = free_name(path); !free) return free;
  if (!make_empty_file(path)) return mounts_.refused(path, errno);
  if (::mount(source.c_str(), path.c_str(), nullptr, MS_BIND, nullptr) != 0)
    return mounts_.refused(path, errno);
  return {};
}

Result<void> PrivateFolders::put_node(const std::string& path, mode_t mode, dev_t device) {
  if (Result<void> free = free_name(path); !free) return free;
  if (::mknod(path.c_str(), mode, device) != 0 || ::chmod(path.c_str(), mode & 07777U) != 0)
    return mounts_.refused(path, errno);
  // It can be made and not be opened where the file system, or what runs this, has no devices.
  if (UniqueFd(::open(path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC))) return {};
  return mounts_.refused(path, errno);
}

Result<void> PrivateFolders::cover_all_but(const std::string& folder, const std::set<std::string>& names) {
  namespace fs = std::filesystem;
  std::error_code error;
  std::vector<fs::directory_entry> all;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    all.push_back(*entry);
  if (error) return mounts_.refused(folder, error.value());
  for (const fs::directory_entry& entry : all) {
    if (names.contains(entry.path().filename()) || entry.is_symlink(error)) continue;
    const char* const path = entry.path().c_str();
    const bool covered =
        entry.is_directory(error)
            ? ::mount("porttape", path, "tmpfs", MS_NOSUID | MS_NODEV | MS_RDONLY, "mode=0555") == 0
            : ::mount("/dev/null", path, nullptr, MS_BIND, nullptr) == 0;
    if (!covered) return mounts_.refused(entry.path().string(), errno);
  }
  return {};
}

Result<void> PrivateFolders::put_folder(const std::string& path, const UniqueFd& clone) {
  if (Result<void> free = free_name(path); !free) return free;
  if (::mkdir(path.c_str(), 0755) != 0 ||
      ::syscall(SYS_move_mount, clone.get(), "", AT_FDCWD, path.c_str(), kEmptyFrom) != 0)
    return mounts_.refused(path, errno);
  return {};
}

Result<UniqueFd> PrivateFolders::cloned_folder(const std::string& folder) const {
  UniqueFd clone(static_cast<int>(
      ::syscall(SYS_open_tree, AT_FDCWD, folder.c_str(), kCloneTree | kRecursive | unsigned{O_CLOEXEC})));
  if (!clone) return mounts_.refused("open_tree " + folder, errno);
  return clone;
}

}  // namespace porttape
