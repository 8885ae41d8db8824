#include "tools/control_place.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <dirent.h>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <pwd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFolder = "porttape";
constexpr std::string_view kEnding = ".sock";

std::string value_of(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

std::string in(const std::string& folder, std::string_view name) {
  return (fs::path(folder) / name).string();
}

std::string of_user(const ControlEnvironment& environment) {
  if (environment.xdg_runtime_dir.starts_with('/')) return in(environment.xdg_runtime_dir, kFolder);
  return in(environment.tmp, "porttape-" + std::to_string(environment.user));
}

// The folders in `folder`, no links; none where it cannot be read.
std::vector<std::string> folders_in(const std::string& folder) {
  std::vector<std::string> found;
  std::error_code unreadable;
  for (fs::directory_iterator entry(folder, unreadable), end; !unreadable && entry != end;
       entry.increment(unreadable)) {
    std::error_code gone;
    if (fs::is_directory(entry->symlink_status(gone))) found.push_back(entry->path().string());
  }
  return found;
}

// A user's daemons may have been started with another environment than ours.
std::vector<std::string> folders_of_user(const ControlEnvironment& environment, uid_t user) {
  const std::string number = std::to_string(user);
  return {in(environment.run, "user/" + number + "/porttape"), in(environment.tmp, "porttape-" + number)};
}

std::vector<std::string> folders_of_all(const ControlEnvironment& environment) {
  std::vector<std::string> folders;
  for (const std::string& user : folders_in(in(environment.run, "user")))
    folders.push_back(in(user, kFolder));
  for (const std::string& folder : folders_in(environment.tmp)) {
    if (fs::path(folder).filename().string().starts_with("porttape-")) folders.push_back(folder);
  }
  return folders;
}

std::vector<std::string> own_folders(const ControlEnvironment& environment) {
  if (const ControlFolder own = control_folder(environment); own.given) return {own.path};
  const std::string system = in(environment.run, kFolder);
  std::vector<std::string> folders = folders_in(system);
  folders.push_back(system);
  if (environment.user != 0) folders.push_back(of_user(environment));
  for (const std::string& folder : folders_of_user(environment, environment.user)) folders.push_back(folder);
  return folders;
}

std::vector<std::string> folders_of(const ControlEnvironment& environment, const OtherUsers& others) {
  std::vector<std::string> folders = own_folders(environment);
  const std::vector<std::string> more = others.all   ? folders_of_all(environment)
                                        : others.one ? folders_of_user(environment, *others.one)
                                                     : std::vector<std::string>();
  folders.insert(folders.end(), more.begin(), more.end());
  std::ranges::sort(folders);
  folders.erase(std::unique(folders.begin(), folders.end()), folders.end());
  return folders;
}

// A folder of sockets, kept open from the look at it on: its name may mean another one at any time.
struct OpenFolder {
  UniqueFd fd;
  uid_t owner = 0;
};
std::optional<OpenFolder> open_folder(const fs::path& folder, int how) {
  OpenFolder opened{UniqueFd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | how))};
  struct stat status {};
  if (!opened.fd || ::fstat(opened.fd.get(), &status) != 0) return std::nullopt;
  opened.owner = status.st_uid;
  return opened;
}

// Anybody can make folders in /tmp, and a user in /run/user/UID: that of the user of its name counts there.
std::optional<OpenFolder> open_trusted(const fs::path& folder, const ControlEnvironment& environment) {
  constexpr std::string_view begin = "porttape-";
  const fs::path parent = folder.parent_path();
  std::optional<uid_t> owner;
  if (parent == environment.tmp) {
    const std::string name = folder.filename().string();
    owner = name.starts_with(begin) ? whole_number<uid_t>(std::string_view(name).substr(begin.size()))
                                    : environment.user;
  } else if (parent.parent_path() == in(environment.run, "user")) {
    owner = whole_number<uid_t>(parent.filename().string());
  } else {
    return open_folder(folder, 0);
  }
  std::optional<OpenFolder> opened = open_folder(folder, O_NOFOLLOW);
  return opened && opened->owner == owner ? std::move(opened) : std::nullopt;
}

std::optional<pid_t> pid_of(const std::string& name) {
  if (!name.ends_with(kEnding)) return std::nullopt;
  const auto pid = whole_number<pid_t>(std::string_view(name).substr(0, name.size() - kEnding.size()));
  return pid && *pid > 0 ? pid : std::nullopt;
}

void add_sockets(const std::string& path, OpenFolder folder, std::vector<ControlSocket>& sockets) {
  const std::unique_ptr<DIR, int (*)(DIR*)> entries(::fdopendir(folder.fd.get()), &::closedir);
  if (!entries) return;
  const int fd = folder.fd.release();  // closed with the entries
  while (const dirent* const entry = ::readdir(entries.get())) {
    const std::string name = static_cast<const char*>(entry->d_name);
    const auto pid = pid_of(name);
    struct stat status {};
    if (pid && ::fstatat(fd, name.c_str(), &status, AT_SYMLINK_NOFOLLOW) == 0 && S_ISSOCK(status.st_mode))
      sockets.push_back({in(path, name), *pid, folder.owner});
  }
}

}  // namespace

ControlEnvironment ControlEnvironment::of_process() {
  return {.user = ::geteuid(),
          .runtime_directory = value_of("RUNTIME_DIRECTORY"),
          .xdg_runtime_dir = value_of("XDG_RUNTIME_DIR")};
}

ControlFolder control_folder(const ControlEnvironment& environment) {
  // systemd names several folders with colons between them.
  const std::string given = environment.runtime_directory.substr(0, environment.runtime_directory.find(':'));
  if (given.starts_with('/')) return {given, true};
  // The units' folders lie in it, which others must reach.
  if (environment.user == 0) return {in(environment.run, kFolder), false, 0755};
  return {of_user(environment)};
}

std::string control_socket(std::string_view folder, pid_t pid) {
  return in(std::string(folder), std::to_string(pid) + std::string(kEnding));
}

Result<OtherUsers> OtherUsers::parse(const std::string& text) {
  if (text == "all") return OtherUsers{.all = true};
  if (const auto number = whole_number<uid_t>(text)) return OtherUsers{.one = *number};
  if (const passwd* const entry = ::getpwnam(text.c_str())) return OtherUsers{.one = entry->pw_uid};
  return make_error(Errc::usage, fmt::format("there is no user {}", in_quotes(text)));
}

std::vector<ControlSocket> control_sockets(const ControlEnvironment& environment, const OtherUsers& others) {
  std::vector<ControlSocket> sockets;
  const ControlFolder own = control_folder(environment);
  for (const std::string& folder : folders_of(environment, others)) {
    const bool given = own.given && folder == own.path;
    if (auto opened = given ? open_folder(folder, 0) : open_trusted(folder, environment))
      add_sockets(folder, std::move(*opened), sockets);
  }
  std::ranges::sort(sockets, {}, &ControlSocket::pid);
  return sockets;
}

std::optional<sockaddr_un> socket_address(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return std::nullopt;
  std::memcpy(address.sun_path, path.data(), path.size());
  return address;
}

bool is_stale_socket(const std::string& path) {
  const auto address = socket_address(path);
  struct stat status {};
  if (!address || ::lstat(path.c_str(), &status) != 0 || !S_ISSOCK(status.st_mode)) return false;
  // Of another type, so that one who listens, or is about to, sees no connection: EPROTOTYPE.
  const UniqueFd probe(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const auto* const where = reinterpret_cast<const sockaddr*>(&*address);
  return probe && ::connect(probe.get(), where, sizeof *address) != 0 && errno == ECONNREFUSED;
}

}  // namespace porttape
