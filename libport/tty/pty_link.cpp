#include "libport/tty/pty_link.hpp"

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <random>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/tty/own_mark.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// Whether it is a link of ours whose pty has gone and whose number another program's pty has got since: a
// program that was killed left it. A link of ours has the time of its pty (make_link).
bool stale(const std::string& path) {
  struct stat link {};
  struct stat node {};
  if (::lstat(path.c_str(), &link) != 0 || ::stat(path.c_str(), &node) != 0 || !is_marked_as_own(link))
    return false;
  return std::pair(node.st_ctim.tv_sec, node.st_ctim.tv_nsec) >
         std::pair(link.st_mtim.tv_sec, link.st_mtim.tv_nsec);
}

// A name that nobody can have planted something under.
std::string temporary_name(const std::string& path) {
  std::random_device random;
  return fmt::format("{}.{:08x}{:08x}.new", path, random(), random());
}

Error not_made(const std::string& path, int error) {
  const char* const advice = error == EEXIST ? "; it is left alone, choose another path" : "";
  const std::string why = error == EEXIST ? "something else is there by now" : errno_text(error);
  return make_error(Errc::usage, fmt::format("link {} cannot be made: {}{}", in_quotes(path), why, advice));
}

// The link under `path`, made under another name first so that it replaces an old one in one step.
Result<UniqueFd> make_link(const std::string& path, const std::string& target,
                           const std::optional<FileIdentity>& old) {
  const std::string temporary = temporary_name(path);
  if (::symlink(target.c_str(), temporary.c_str()) != 0) return not_made(path, errno);
  struct stat pty {};
  if (::stat(target.c_str(), &pty) == 0) mark_as_own(AT_FDCWD, temporary, pty.st_ctim);
  UniqueFd link(::open(temporary.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
  const int error = link ? move_over(AT_FDCWD, temporary, path, old) : errno;
  if (error == 0) return link;
  (void)::unlink(temporary.c_str());
  return not_made(path, error);
}

// Whether the path is free, or a link that may go.
Result<void> check_place(const std::string& path, const std::string& target) {
  std::error_code error;
  const fs::path parent = fs::absolute(path).parent_path();
  if (!fs::is_directory(parent, error)) {
    return make_error(Errc::usage, fmt::format("link {}: its folder does not exist; type mkdir -p {}",
                                               in_quotes(path), shell_word(parent.string())));
  }
  const fs::file_status status = fs::symlink_status(path, error);
  if (!fs::exists(status)) return {};
  if (!fs::is_symlink(status)) {
    return make_error(Errc::usage,
                      fmt::format("link {} exists and is not a link; it is left alone, choose another path",
                                  in_quotes(path)));
  }
  const fs::path points_to = fs::read_symlink(path, error);
  if (points_to == target || !fs::exists(path, error) || stale(path)) return {};
  return make_error(
      Errc::usage,
      fmt::format("link {} exists and points to {}, which is in use; remove it or choose another path",
                  in_quotes(path), in_quotes(points_to.string())));
}

}  // namespace

Result<PtyLink> PtyLink::publish(const std::string& path, const std::string& target) {
  const std::optional<FileIdentity> old = FileIdentity::at(AT_FDCWD, path);  // before it is looked at
  if (Result<void> place = check_place(path, target); !place) return place.error();
  Result<UniqueFd> link = make_link(path, target, old);
  if (!link) return link.error();
  return PtyLink(path, std::move(*link));
}

PtyLink& PtyLink::operator=(PtyLink&& other) noexcept {
  if (this != &other) {
    remove();
    path_ = std::move(other.path_);
    link_ = std::move(other.link_);
  }
  return *this;
}

PtyLink::~PtyLink() { remove(); }

Result<void> PtyLink::retarget(const std::string& target) {
  Result<UniqueFd> made = make_link(path_, target, FileIdentity::of(link_.get()));
  if (!made) return made.error();
  link_ = std::move(*made);
  return {};
}

void PtyLink::remove() { (void)remove_if_same(AT_FDCWD, path_, link_.get()); }

}  // namespace porttape
