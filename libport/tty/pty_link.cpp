#include "libport/tty/pty_link.hpp"

#include <array>
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <random>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

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

// The link under `path`, made under another name first so that it replaces an old one in one step.
Result<void> make_link(const std::string& path, const std::string& target) {
  const std::string temporary = temporary_name(path);
  const bool linked = ::symlink(target.c_str(), temporary.c_str()) == 0;
  struct stat pty {};
  if (linked && ::stat(target.c_str(), &pty) == 0) mark_as_own(temporary, pty.st_ctim);
  if (!linked || std::rename(temporary.c_str(), path.c_str()) != 0) {
    const int error = errno;
    if (linked) (void)::unlink(temporary.c_str());
    return make_error(Errc::usage,
                      fmt::format("link {} cannot be made: {}", in_quotes(path), errno_text(error)));
  }
  return {};
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
  if (Result<void> place = check_place(path, target); !place) return place.error();
  if (Result<void> made = make_link(path, target); !made) return made.error();
  return PtyLink(path, target);
}

PtyLink::PtyLink(std::string path, std::string target) : path_(std::move(path)), target_(std::move(target)) {}

PtyLink::PtyLink(PtyLink&& other) noexcept
    : path_(std::exchange(other.path_, {})), target_(std::exchange(other.target_, {})) {}

PtyLink& PtyLink::operator=(PtyLink&& other) noexcept {
  if (this != &other) {
    remove();
    path_ = std::exchange(other.path_, {});
    target_ = std::exchange(other.target_, {});
  }
  return *this;
}

PtyLink::~PtyLink() { remove(); }

Result<void> PtyLink::retarget(const std::string& target) {
  Result<void> made = make_link(path_, target);
  if (made) target_ = target;
  return made;
}

void PtyLink::remove() {
  if (path_.empty()) return;
  std::array<char, 4096> now{};
  const ssize_t size = ::readlink(path_.c_str(), now.data(), now.size());
  if (size >= 0 && std::string_view(now.data(), static_cast<std::size_t>(size)) == target_)
    (void)::unlink(path_.c_str());
}

}  // namespace porttape
