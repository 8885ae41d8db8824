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
bool stale(const TrustedName& place) {
  struct stat link {};
  struct stat node {};
  const int folder = place.folder.get();
  if (::fstatat(folder, place.name.c_str(), &link, AT_SYMLINK_NOFOLLOW) != 0 ||
      ::fstatat(folder, place.name.c_str(), &node, 0) != 0 || !is_marked_as_own(link))
    return false;
  return std::pair(node.st_ctim.tv_sec, node.st_ctim.tv_nsec) >
         std::pair(link.st_mtim.tv_sec, link.st_mtim.tv_nsec);
}

// A name that nobody can have planted something under.
std::string temporary_name(const std::string& name) {
  std::random_device random;
  return fmt::format("{}.{:08x}{:08x}.new", name, random(), random());
}

Error not_made(const std::string& path, int error) {
  const char* const advice = error == EEXIST ? "; it is left alone, choose another path" : "";
  const std::string why = error == EEXIST ? "something else is there by now" : errno_text(error);
  return make_error(Errc::usage, fmt::format("link {} cannot be made: {}{}", in_quotes(path), why, advice));
}

Result<TrustedName> find_place(const std::string& path) {
  Result<TrustedName> place = find_trusted_name(path);
  if (place) return place;
  return make_error(Errc::usage, fmt::format("link {}: {}", in_quotes(path), place.error().message));
}

// Whether the path's folder still is this one. Somebody may have made another of its name. Opens nothing:
// there may be no descriptor left.
bool is_folder_of(const TrustedName& place, const std::string& path) {
  struct stat ours {};
  struct stat now {};
  std::error_code error;
  const fs::path folder = fs::absolute(path, error).parent_path();
  return !error && ::fstat(place.folder.get(), &ours) == 0 && ::stat(folder.c_str(), &now) == 0 &&
         ours.st_dev == now.st_dev && ours.st_ino == now.st_ino;
}

// The link under that name, made under another one first so that it replaces an old one in one step.
Result<UniqueFd> make_link(const TrustedName& place, const std::string& path, const std::string& target,
                           const std::optional<FileIdentity>& old) {
  const int folder = place.folder.get();
  const std::string temporary = temporary_name(place.name);
  if (::symlinkat(target.c_str(), folder, temporary.c_str()) != 0) return not_made(path, errno);
  struct stat pty {};
  if (::stat(target.c_str(), &pty) == 0) mark_as_own(folder, temporary, pty.st_ctim);
  UniqueFd link(::openat(folder, temporary.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
  const int error = link ? move_over(folder, temporary, place.name, old) : errno;
  if (error == 0) return link;
  (void)::unlinkat(folder, temporary.c_str(), 0);
  return not_made(path, error);
}

// Whether the name is free, or a link that may go.
Result<void> check_place(const TrustedName& place, const std::string& path, const std::string& target) {
  const int folder = place.folder.get();
  struct stat status {};
  if (::fstatat(folder, place.name.c_str(), &status, AT_SYMLINK_NOFOLLOW) != 0) return {};
  if (!S_ISLNK(status.st_mode)) {
    return make_error(Errc::usage,
                      fmt::format("link {} exists and is not a link; it is left alone, choose another path",
                                  in_quotes(path)));
  }
  const std::string points_to = link_text(folder, place.name);
  const bool dangling = ::fstatat(folder, place.name.c_str(), &status, 0) != 0;
  if (points_to == target || dangling || stale(place)) return {};
  return make_error(
      Errc::usage,
      fmt::format("link {} exists and points to {}, which is in use; remove it or choose another path",
                  in_quotes(path), in_quotes(points_to)));
}

}  // namespace

Result<PtyLink> PtyLink::publish(const std::string& path, const std::string& target) {
  Result<TrustedName> place = find_place(path);
  if (!place) return place.error();
  // Before it is looked at.
  const std::optional<FileIdentity> old = FileIdentity::at(place->folder.get(), place->name);
  if (Result<void> free = check_place(*place, path, target); !free) return free.error();
  Result<UniqueFd> link = make_link(*place, path, target, old);
  if (!link) return link.error();
  return PtyLink(path, std::move(*place), std::move(*link));
}

PtyLink& PtyLink::operator=(PtyLink&& other) noexcept {
  if (this != &other) {
    remove();
    path_ = std::move(other.path_);
    place_ = std::move(other.place_);
    link_ = std::move(other.link_);
  }
  return *this;
}

PtyLink::~PtyLink() { remove(); }

Result<void> PtyLink::retarget(const std::string& target) {
  if (!is_folder_of(place_, path_)) {
    Result<TrustedName> place = find_place(path_);
    if (!place) return place.error();
    place_ = std::move(*place);
  }
  Result<UniqueFd> made = make_link(place_, path_, target, FileIdentity::of(link_.get()));
  if (!made) return made.error();
  link_ = std::move(*made);
  return {};
}

void PtyLink::remove() { (void)remove_if_same(place_.folder.get(), place_.name, link_.get()); }

}  // namespace porttape
