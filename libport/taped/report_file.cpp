#include "libport/taped/report_file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <climits>
#include <cstdint>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "libport/base/clock.hpp"
#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/taped/report_place.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kReaderLimit(1000);

// The system calls here give an errno, 0 when all went well.

// To what a reader empties, or does not: PIPE_BUF bytes at a time are taken at once where poll() says so.
int write_with_patience(int fd, std::string_view text) {
  const auto until = machine_clock().now() + kReaderLimit;
  while (!text.empty()) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - machine_clock().now()).count();
    pollfd ready{.fd = fd, .events = POLLOUT, .revents = 0};
    const int polled = ::poll(&ready, 1, static_cast<int>(std::max<std::int64_t>(left, 0)));
    if (polled < 0 && errno == EINTR) continue;
    if (polled <= 0) return polled < 0 ? errno : ETIMEDOUT;
    const ssize_t n = ::write(fd, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
    if (n < 0 && errno == EINTR) continue;
    // What is ready and takes nothing has no more time than what is never ready.
    if (n < 0 && errno == EAGAIN && left > 0) continue;
    if (n < 0 && errno == EAGAIN) return ETIMEDOUT;
    if (n <= 0) return n < 0 ? errno : EIO;
    text.remove_prefix(static_cast<std::size_t>(n));
  }
  return 0;
}

Result<void> replace_report(ReportPlace place, std::string_view text, mode_t kept) {
  Result<NewFile> made = NewFile::create_in(std::move(place.folder), place.file, true);
  if (!made) return made.error();
  if (Result<void> strict = made->keep(kept); !strict) return strict;
  if (Result<void> added = made->add(text); !added) return added;
  return made->finish();
}

// A duplicate of the descriptor that the place is, of this process. A file that is opened anew has a place to
// write of its own there, and what is printed beside would lie over the report.
UniqueFd own_descriptor(const ReportPlace& place) {
  const auto number = whole_number<int>(place.name);
  if (place.kind != ReportPlace::Kind::descriptor || !number) return {};
  const std::optional<FileIdentity> folder = FileIdentity::of(place.folder.get());
  if (!folder || folder != FileIdentity::at(AT_FDCWD, "/proc/self/fd")) return {};
  struct stat file {};
  if (::fstat(*number, &file) != 0 || !S_ISREG(file.st_mode)) return {};
  return UniqueFd(::fcntl(*number, F_DUPFD_CLOEXEC, 0));
}

int write_in_place(const ReportPlace& place, std::string_view text) {
  if (const UniqueFd own = own_descriptor(place)) return write_with_patience(own.get(), text);
  // O_NONBLOCK: a pipe that nobody has open for reading is an error, not a wait.
  const int follow = place.kind == ReportPlace::Kind::descriptor ? 0 : O_NOFOLLOW;
  UniqueFd fd(::openat(place.folder.get(), place.name.c_str(),
                       O_WRONLY | O_APPEND | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | follow));
  if (!fd) return errno;
  if (const int error = write_with_patience(fd.get(), text); error != 0) return error;
  return ::close(fd.release()) == 0 ? 0 : errno;
}

Error cannot_write(std::string_view what, const std::string& path, int error) {
  const std::string why =
      error == ETIMEDOUT || error == ENXIO ? "nobody reads what it leads to" : errno_text(error);
  return make_error(Errc::io, fmt::format("{} {} cannot be written: {}", what, in_quotes(path), why));
}

// Errno of what would keep the file there from being replaced. A file without a name is the surest probe; not
// all file systems have them.
int probe_replace(const ReportPlace& place) {
  const int folder = place.folder.get();
  if (UniqueFd probe(::openat(folder, ".", O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600)); !probe) {
    if (errno != EOPNOTSUPP && errno != EISDIR && errno != EINVAL) return errno;
    if (::faccessat(folder, ".", W_OK | X_OK, 0) != 0) return errno;
  }
  struct stat parent {};
  struct stat old {};
  if (::fstat(folder, &parent) != 0) return errno;
  const bool sticky = (parent.st_mode & S_ISVTX) != 0 && ::geteuid() != 0 && parent.st_uid != ::geteuid();
  const bool exists = ::fstatat(folder, place.name.c_str(), &old, AT_SYMLINK_NOFOLLOW) == 0;
  if (sticky && exists && old.st_uid != ::geteuid()) return EPERM;
  return 0;
}

// The file that a name leads to, as far as it is there.
fs::path plain(const std::string& name) {
  std::error_code error;
  const fs::path found = fs::weakly_canonical(fs::absolute(name, error), error);
  return error ? fs::path(name).lexically_normal() : found;
}

}  // namespace

Result<void> check_report_place(const std::string& path, std::string_view what) {
  if (path == "-") return {};
  std::error_code error;
  if (fs::is_directory(path, error))
    return make_error(Errc::usage, fmt::format("{} {} is a folder; name a file", what, in_quotes(path)));
  const Result<ReportPlace> place = find_report_place(path);
  if (!place)
    return make_error(Errc::usage, fmt::format("{} {}: {}", what, in_quotes(path), place.error().message));
  const bool replaced = place->kind == ReportPlace::Kind::replaced;
  const bool writable = replaced || ::faccessat(place->folder.get(), place->name.c_str(), W_OK, 0) == 0;
  const int why = replaced ? probe_replace(*place) : writable ? 0 : errno;
  if (why == 0) return {};
  return make_error(Errc::usage, fmt::format("{} {} cannot be written: {}; name another file", what,
                                             in_quotes(path), errno_text(why)));
}

Result<void> check_report_free(const std::string& path, bool overwrite, const std::string& input) {
  if (path == "-") return {};
  Result<ReportPlace> place = find_report_place(path);
  std::error_code error;
  // Any other trouble is check_report_place()'s.
  if (!place || place->kind != ReportPlace::Kind::replaced || !fs::exists(place->file, error)) return {};
  if (fs::equivalent(place->file, input, error))
    return make_error(Errc::usage, fmt::format("report {} is {}, which is read; name another file",
                                               in_quotes(path), in_quotes(input)));
  if (!overwrite)
    return make_error(Errc::usage,
                      fmt::format("report {} exists already; name another, or --overwrite", in_quotes(path)));
  const Result<NewFile> replaceable = NewFile::create_in(std::move(place->folder), place->file, true);
  return replaceable ? Result<void>() : Result<void>(replaceable.error());
}

Result<void> check_report_apart(const std::string& path, const TapePaths& tape) {
  for (const auto& file : {tape.read, tape.write, tape.events}) {
    if (path.empty() || path == "-" || plain(path) != plain(file)) continue;
    return make_error(Errc::usage,
                      fmt::format("report {} is a file of the tape; name another file", in_quotes(path)));
  }
  return {};
}

Result<void> check_reports_apart(const std::string& report, const std::string& junit) {
  if (report.empty() || junit.empty() || !is_same_report_place(report, junit)) return {};
  return usage_error(
      fmt::format("option 'junit': {} has the report already; name another file", in_quotes(junit)));
}

Result<void> write_report(const std::string& path, std::string_view text, std::string_view what,
                          mode_t kept) {
  int error = 0;
  if (path == "-") {
    error = write_with_patience(STDOUT_FILENO, text);
  } else {
    Result<ReportPlace> place = find_report_place(path);
    if (!place)
      return make_error(
          Errc::io, fmt::format("{} {} cannot be written: {}", what, in_quotes(path), place.error().message));
    if (place->kind == ReportPlace::Kind::replaced) {
      const Result<void> replaced = replace_report(std::move(*place), text, kept);
      if (replaced) return {};
      return make_error(Errc::io, fmt::format("{} {}", what, replaced.error().message));
    }
    error = write_in_place(*place, text);
  }
  if (error == 0) return {};
  return cannot_write(what, path, error);
}

}  // namespace porttape
