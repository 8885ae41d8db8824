#include "libport/tty/pty_bind.hpp"

#include <cerrno>
#include <cstdint>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>
#include <string_view>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/tty/own_mark.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// linux/mount.h of 6.5 and later.
constexpr unsigned kMoveMountBeneath = 0x200;

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

// 0: not known, as before Linux 5.8.
std::uint64_t mount_id(int folder, const std::string& name) {
  struct statx status {};
  const int flags = AT_SYMLINK_NOFOLLOW | AT_NO_AUTOMOUNT | (name.empty() ? AT_EMPTY_PATH : 0);
  if (::statx(folder, name.c_str(), flags, STATX_MNT_ID, &status) != 0) return 0;
  return (status.stx_mask & STATX_MNT_ID) != 0 ? status.stx_mnt_id : 0;
}

// A line of /proc/self/mountinfo: what of its file system is mounted (`/3` of a pty), and on which mount.
struct Mounted {
  std::uint64_t id = 0;
  std::uint64_t parent = 0;
  std::string root;
};

std::optional<Mounted> find_mount(const std::function<bool(const Mounted&)>& is_it) {
  std::ifstream mounts("/proc/self/mountinfo");
  for (std::string line; std::getline(mounts, line);) {
    std::istringstream words(line);
    Mounted each;
    std::string device;
    if (words >> each.id >> each.parent >> device >> each.root && is_it(each)) return each;
  }
  return std::nullopt;
}

// Returns the topmost mount on a name, or std::nullopt where nothing is mounted.
std::optional<Mounted> mounted_on(int folder, const std::string& name) {
  const std::uint64_t id = mount_id(folder, name);
  if (id == mount_id(folder, {})) return std::nullopt;
  return find_mount([id](const Mounted& each) { return each.id == id; });
}

bool is_covered(int mount) {
  const std::uint64_t id = mount_id(mount, {});
  return id != 0 && find_mount([id](const Mounted& each) { return each.parent == id; }).has_value();
}

bool is_dead(const Mounted& mount) { return mount.root.ends_with("//deleted"); }

// A path that leads to the open file itself, even if its name means another one by now.
std::string path_of(int fd) { return fmt::format("/proc/self/fd/{}", fd); }

bool detach(int mount) { return ::umount2(path_of(mount).c_str(), MNT_DETACH) == 0; }

UniqueFd open_name(int folder, const std::string& name) {
  return UniqueFd(::openat(folder, name.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
}

// Mounts that killed programs left there, one on the other.
void unmount_dead(int folder, const std::string& name) {
  for (;;) {
    const auto mounted = mounted_on(folder, name);
    if (!mounted || !is_dead(*mounted)) return;
    const UniqueFd last = open_name(folder, name);
    if (!last || mount_id(last.get(), {}) != mounted->id || !detach(last.get())) return;
  }
}

UniqueFd clone_of(const std::string& pty) {
  return UniqueFd(::open_tree(AT_FDCWD, pty.c_str(), OPEN_TREE_CLONE | OPEN_TREE_CLOEXEC));
}

bool move_mount_to(int mount, int place, unsigned how) {
  return ::move_mount(mount, "", place, "", MOVE_MOUNT_F_EMPTY_PATH | MOVE_MOUNT_T_EMPTY_PATH | how) == 0;
}

}  // namespace

Result<PtyBind> PtyBind::publish(const std::string& path, const std::string& pty) {
  Result<TrustedName> place = find_trusted_name(path);
  if (!place) return bind_error(path, place.error().message);
  PtyBind bind(fs::absolute(path).string(), std::move(place->folder), std::move(place->name));
  if (Result<void> taken = bind.take_place(); !taken) return taken.error();
  if (Result<void> mounted = bind.mount(pty); !mounted) return mounted.error();
  return bind;
}

// Makes the file, or sees to it that an empty one is there.
Result<void> PtyBind::take_place() {
  unmount_dead(folder_.get(), name_);
  const int how = O_RDONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
  UniqueFd made(::openat(folder_.get(), name_.c_str(), how, 0600));
  if (!made && errno != EEXIST) return bind_error(path_, "cannot be made: " + errno_text(errno));
  made_ = static_cast<bool>(made);
  file_ = made ? std::move(made) : open_name(folder_.get(), name_);
  struct stat status {};
  if (!file_ || ::fstat(file_.get(), &status) != 0) return bind_error(path_, errno_text(errno));
  if (made_) {
    mark_as_own(folder_.get(), name_, status.st_ctim);
    return {};
  }
  if (const auto mounted = mounted_on(folder_.get(), name_))
    return bind_error(
        path_, fmt::format("{} is mounted there, and in use; choose another path", in_quotes(mounted->root)));
  if (!S_ISREG(status.st_mode) || status.st_size > 0)
    return bind_error(path_, "exists and is not an empty file; it is left alone, choose another path");
  made_ = is_marked_as_own(status);
  return {};
}

// Mounts the pty on our file, and fails if the name means another file.
Result<void> PtyBind::mount(const std::string& pty) {
  const UniqueFd file = open_name(folder_.get(), name_);
  if (!file) return bind_error(path_, errno_text(errno));
  if (FileIdentity::of(file.get()) != FileIdentity::of(file_.get()))
    return bind_error(path_, "something else is there by now; it is left alone");
  UniqueFd tree = clone_of(pty);
  if (tree && move_mount_to(tree.get(), file.get(), 0)) {
    mount_ = std::move(tree);
    return {};
  }
  if (errno != ENOSYS) return mount_error(path_, errno);
  return mount_by_names(pty, file.get());
}

// Before Linux 5.2.
Result<void> PtyBind::mount_by_names(const std::string& pty, int file) {
  if (::mount(pty.c_str(), path_of(file).c_str(), nullptr, MS_BIND, nullptr) != 0)
    return mount_error(path_, errno);
  mount_ = open_name(folder_.get(), name_);
  return mount_ ? Result<void>() : Result<void>(mount_error(path_, errno));
}

PtyBind::PtyBind(PtyBind&& other) noexcept = default;

PtyBind::~PtyBind() { remove(); }

// From Linux 6.5 on the new pty slips under the old one, which then goes: the path is never anything else.
Result<void> PtyBind::retarget(const std::string& pty) {
  if (mount_ && !is_covered(mount_.get())) {
    UniqueFd tree = clone_of(pty);
    if (tree && move_mount_to(tree.get(), mount_.get(), kMoveMountBeneath)) {
      (void)detach(mount_.get());
      mount_ = std::move(tree);
      return {};
    }
  }
  if (Result<void> gone = unmount(); !gone) return gone;
  return mount(pty);
}

Result<void> PtyBind::unmount() {
  if (!mount_) return {};
  if (is_covered(mount_.get()))
    return bind_error(path_, "something else is mounted there by now; it is left alone");
  (void)detach(mount_.get());  // unless somebody else did
  mount_.reset();
  return {};
}

void PtyBind::remove() {
  if (!folder_ || !unmount() || !made_) return;
  struct stat status {};
  if (::fstat(file_.get(), &status) == 0 && status.st_size == 0)
    (void)remove_if_same(folder_.get(), name_, file_.get());
}

}  // namespace porttape
