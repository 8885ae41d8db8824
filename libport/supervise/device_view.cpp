#include "libport/supervise/device_view.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>

#include "libport/base/printable.hpp"
#include "libport/base/tty_device.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/supervise/device_tree.hpp"
#include "libport/supervise/port_devices.hpp"
#include "libport/supervise/private_folders.hpp"
#include "libport/supervise/private_mounts.hpp"

namespace porttape {
namespace {

bool is_folder(const char* path) {
  struct stat status {};
  return ::stat(path, &status) == 0 && S_ISDIR(status.st_mode);
}

// The kernel's node for new ptys looks for `pts` beside itself, and a node that is mounted alone has nothing
// beside it. So root makes one of its own. Where that is not allowed the node is reached in the folder that
// it was in, of which nothing but these two is to be had.
Result<void> own_dev(PrivateFolders& folders) {
  struct stat ptmx {};
  if (::lstat("/dev/ptmx", &ptmx) != 0 || !S_ISCHR(ptmx.st_mode)) return folders.own("/dev");
  const Result<UniqueFd> before = folders.cloned_folder("/dev");
  if (!before) return before.error();
  if (Result<void> owned = folders.own("/dev"); !owned) return owned;
  if (folders.put_node("/dev/ptmx", ptmx.st_mode, ptmx.st_rdev)) return {};
  if (Result<void> put = folders.put_folder("/dev/.porttape", *before); !put) return put;
  if (Result<void> covered = folders.cover_all_but("/dev/.porttape", {"ptmx", "pts"}); !covered)
    return covered;
  return folders.put_link("/dev/ptmx", ".porttape/ptmx");
}

// Of /sys and /run what is there: a system without it shows its programs none.
Result<void> put_tree(PrivateFolders& folders, const DeviceTree& tree, const std::string& number) {
  if (is_folder("/sys")) {
    for (const auto& [path, text] : tree.files) {
      if (Result<void> put = folders.put_file(path, text); !put) return put;
    }
    for (const auto& [path, target] : tree.links) {
      if (Result<void> put = folders.put_link(path, target); !put) return put;
    }
  }
  for (const auto& [path, target] : tree.names) {
    if (Result<void> put = folders.put_link(path, target); !put) return put;
  }
  if (!is_folder("/run")) return {};
  if (::access("/run/udev/control", F_OK) != 0) {
    if (Result<void> put = folders.put_file("/run/udev/control", ""); !put) return put;
  }
  return folders.put_file("/run/udev/data/c" + number, tree.udev_data);
}

Result<void> put_port(PrivateFolders& folders, const DevicePort& port, const std::string& node) {
  struct stat status {};
  if (::stat(node.c_str(), &status) != 0)
    return make_error(Errc::io, fmt::format("{}: {}", port.node, errno_text(errno)));
  if (Result<void> put = folders.put_mount(port.identity.path, node); !put) return put;
  // Those of the device that has been here tell of that.
  for (const char* const links : {"/dev/serial/by-id", "/dev/serial/by-path"}) {
    const std::string name = port.identity.path.substr(port.identity.path.rfind('/') + 1);
    if (Result<void> dropped = folders.drop_links(links, name); !dropped) return dropped;
  }
  const std::string number = fmt::format("{}:{}", ::major(status.st_rdev), ::minor(status.st_rdev));
  return put_tree(folders, device_tree(port.identity, status.st_rdev), number);
}

// Only a port's place may be taken: who talks to `/dev/net/tun` or a disk means that. A pty under such a name
// is the port of another porttape.
Result<void> check_place(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return {};
  if (S_ISCHR(status.st_mode) && (is_pty(status.st_rdev) || is_serial(status.st_rdev))) return {};
  return usage_error("port " + in_quotes(path) +
                     " is something else than a serial port on this machine; give another name by --as");
}

std::string by_descriptor(const UniqueFd& file) { return fmt::format("/proc/self/fd/{}", file.get()); }

Result<void> build_view(const PrivateMounts& mounts, const std::vector<DevicePort>& ports) {
  PrivateFolders folders(mounts);
  std::vector<UniqueFd> nodes;
  for (const DevicePort& port : ports) {
    nodes.emplace_back(::open(port.node.c_str(), O_PATH | O_CLOEXEC));
    if (!nodes.back()) return mounts.refused(port.node, errno);
  }
  if (Result<void> owned = own_dev(folders); !owned) return owned;
  for (std::size_t at = 0; at < ports.size(); ++at) {
    if (Result<void> put = put_port(folders, ports[at], by_descriptor(nodes[at])); !put) return put;
  }
  return {};
}

}  // namespace

Result<void> enter_device_view(const std::vector<DevicePort>& ports) {
  for (const DevicePort& port : ports) {
    if (Result<void> checked = check_identity(port.identity); !checked) return checked;
    if (Result<void> checked = check_place(port.identity.path); !checked) return checked;
  }
  std::error_code unknown;
  const std::filesystem::path here = std::filesystem::current_path(unknown);
  const Result<PrivateMounts> mounts = PrivateMounts::enter();
  if (!mounts) return mounts.error();
  const mode_t mask = ::umask(022);
  Result<void> built = build_view(*mounts, ports);
  ::umask(mask);
  // One that stands in /dev would stay in the host's.
  if (!unknown) std::filesystem::current_path(here, unknown);
  return built ? mounts->drop_gained() : built;
}

Result<void> can_enter_device_view(const std::vector<DevicePort>& ports) {
  std::array<int, 2> pair{};
  if (::pipe2(pair.data(), O_CLOEXEC) != 0) return make_error(Errc::io, "a pipe: " + errno_text(errno));
  const UniqueFd from(pair[0]);
  UniqueFd to(pair[1]);
  const pid_t child = ::fork();
  if (child < 0) return make_error(Errc::io, "a process: " + errno_text(errno));
  if (child == 0) {
    const Result<void> entered = enter_device_view(ports);
    if (entered) ::_exit(0);
    const std::string& text = entered.error().message;
    (void)!::write(to.get(), text.data(), text.size());
    ::_exit(1);
  }
  to.reset();
  std::string text(2048, '\0');
  ssize_t size = 0;
  while ((size = ::read(from.get(), text.data(), text.size())) < 0 && errno == EINTR) {
  }
  text.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  int status = 0;
  pid_t ended = 0;
  while ((ended = ::waitpid(child, &status, 0)) < 0 && errno == EINTR) {
  }
  if (ended == child && WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  return make_error(Errc::io, text.empty() ? "the process that tried it was ended" : text);
}

}  // namespace porttape
