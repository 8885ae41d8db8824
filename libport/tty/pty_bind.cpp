#include "libport/tty/pty_bind.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/tty/own_mark.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// linux/mount.h of 6.5 and later.
constexpr unsigned kMoveMountBeneath = 0x200;

constexpr int kMostLayers = 100;  // of dead mounts, one on the other

Error bind_error(const std::string& path, std::string_view what) {
  return make_error(Errc::usage, fmt::format("option 'bind': {}: {}", in_quotes(path), what));
}

Error mount_error(const std::string& path, int error_number) {
  const bool no_right = error_number == EPERM || error_number == EACCES;
  return bind_error(
      path,
      fmt::format("cannot be mounted on: {}{}", errno_text(error_number),
                  no_right ? "; it needs CAP_SYS_ADMIN: start it as root (in a container with --cap-add "
                             "SYS_ADMIN), or use link=PATH, which needs nothing"
                           : ""));
}

// As /proc/self/mountinfo writes a path: blanks and backslashes as \ooo.
std::string unescaped(std::string_view text) {
  std::string plain;
  for (std::size_t at = 0; at < text.size(); ++at) {
    if (text[at] != '\\' || at + 3 >= text.size()) {
      plain += text[at];
      continue;
    }
    const auto digit = [&](std::size_t n) { return text[at + n] - '0'; };
    plain += static_cast<char>(digit(1) * 64 + digit(2) * 8 + digit(3));
    at += 3;
  }
  return plain;
}

// What is mounted on a path, within its file system: `/3` of a pty; none: nothing. The last one counts.
std::optional<std::string> mounted_on(const std::string& path) {
  std::ifstream mounts("/proc/self/mountinfo");
  std::optional<std::string> found;
  for (std::string line; std::getline(mounts, line);) {
    std::istringstream words(line);
    std::string id, parent, device, root, place;
    if (words >> id >> parent >> device >> root >> place && unescaped(place) == path) found = unescaped(root);
  }
  return found;
}

bool is_dead(const std::string& mounted) { return mounted.ends_with("//deleted"); }

// Mounts that killed programs left there.
void unmount_dead(const std::string& path) {
  for (int n = 0; n < kMostLayers; ++n) {
    const auto mounted = mounted_on(path);
    if (!mounted || !is_dead(*mounted) || ::umount2(path.c_str(), MNT_DETACH | UMOUNT_NOFOLLOW) != 0) return;
  }
}

// The new pty slips under the old one, which then goes: the path is never anything else.
bool exchange_mounts(const std::string& path, const std::string& pty) {
  const UniqueFd tree(::open_tree(AT_FDCWD, pty.c_str(), OPEN_TREE_CLONE | OPEN_TREE_CLOEXEC));
  return tree &&
         ::move_mount(tree.get(), "", AT_FDCWD, path.c_str(), MOVE_MOUNT_F_EMPTY_PATH | kMoveMountBeneath) ==
             0 &&
         ::umount2(path.c_str(), MNT_DETACH | UMOUNT_NOFOLLOW) == 0;
}

}  // namespace

Result<PtyBind> PtyBind::publish(const std::string& path, const std::string& pty) {
  std::error_code error;
  const fs::path given = fs::absolute(path);
  const fs::path folder = fs::canonical(given.parent_path(), error);
  if (error || !fs::is_directory(folder, error)) {
    return bind_error(path,
                      "its folder does not exist; type mkdir -p " + shell_word(given.parent_path().string()));
  }
  PtyBind bind((folder / given.filename()).string());
  if (Result<void> taken = bind.take_place(); !taken) return taken.error();
  if (Result<void> mounted = bind.mount(pty); !mounted) return mounted.error();
  return bind;
}

// Makes the file, or sees to it that an empty one is there.
Result<void> PtyBind::take_place() {
  unmount_dead(path_);
  const UniqueFd made(::open(path_.c_str(), O_RDONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (made) {
    struct stat created {};
    if (::fstat(made.get(), &created) == 0) mark_as_own(path_, created.st_ctim);
    made_ = true;
    return {};
  }
  if (errno != EEXIST) return bind_error(path_, "cannot be made: " + errno_text(errno));
  struct stat status {};
  if (::lstat(path_.c_str(), &status) != 0) return bind_error(path_, errno_text(errno));
  if (const auto mounted = mounted_on(path_))
    return bind_error(
        path_, fmt::format("{} is mounted there, and in use; choose another path", in_quotes(*mounted)));
  if (!S_ISREG(status.st_mode) || status.st_size > 0)
    return bind_error(path_, "exists and is not an empty file; it is left alone, choose another path");
  made_ = is_marked_as_own(status);
  return {};
}

Result<void> PtyBind::mount(const std::string& pty) {
  if (::mount(pty.c_str(), path_.c_str(), nullptr, MS_BIND, nullptr) != 0) {
    const int error = errno;
    return mount_error(path_, error);
  }
  struct stat status {};
  if (::stat(path_.c_str(), &status) != 0) return mount_error(path_, errno);
  device_ = status.st_dev;
  inode_ = status.st_ino;
  return {};
}

PtyBind::PtyBind(PtyBind&& other) noexcept
    : path_(std::exchange(other.path_, {})),
      made_(other.made_),
      device_(other.device_),
      inode_(std::exchange(other.inode_, 0)) {}

PtyBind::~PtyBind() { remove(); }

// Whether what is mounted there is ours.
bool PtyBind::is_there() const {
  struct stat status {};
  return inode_ != 0 && ::lstat(path_.c_str(), &status) == 0 && status.st_dev == device_ &&
         status.st_ino == inode_;
}

Result<void> PtyBind::retarget(const std::string& pty) {
  struct stat status {};
  if (is_there() && exchange_mounts(path_, pty) && ::stat(path_.c_str(), &status) == 0) {
    device_ = status.st_dev;
    inode_ = status.st_ino;
    return {};
  }
  unmount();
  if (mounted_on(path_)) return bind_error(path_, "something else is mounted there by now; it is left alone");
  return mount(pty);
}

void PtyBind::unmount() {
  if (is_there()) (void)::umount2(path_.c_str(), MNT_DETACH | UMOUNT_NOFOLLOW);
  inode_ = 0;
}

void PtyBind::remove() {
  if (path_.empty()) return;
  unmount();
  struct stat status {};
  if (made_ && ::lstat(path_.c_str(), &status) == 0 && S_ISREG(status.st_mode) && status.st_size == 0)
    (void)::unlink(path_.c_str());
}

}  // namespace porttape
