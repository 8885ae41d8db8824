#include "libport/tty/uucp_lock.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <random>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// Returns the first bytes of a regular file. The result is empty if the file cannot be read, or is a link:
// anybody may make one in a folder of locks, to a file that only we may read.
std::string beginning_of(const std::string& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  struct stat status {};
  if (!fd || ::fstat(fd.get(), &status) != 0 || !S_ISREG(status.st_mode)) return {};
  std::array<char, 64> buffer{};
  const ssize_t size = ::read(fd.get(), buffer.data(), buffer.size());
  return {buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0))};
}

// Four bytes with a zero among them are a binary number: each that a process can have has such a byte, and no
// text has. Of text it is the first word.
std::optional<pid_t> pid_in(const std::string& content) {
  constexpr std::string_view kBlanks = " \t\r\n";
  pid_t pid = 0;
  if (content.size() == sizeof pid && content.find('\0') != std::string::npos) {
    std::memcpy(&pid, content.data(), sizeof pid);
  } else if (const std::size_t begin = content.find_first_not_of(kBlanks); begin != std::string::npos) {
    const std::size_t end = std::min(content.find_first_of(kBlanks, begin), content.size());
    pid = whole_number<pid_t>(content.substr(begin, end - begin)).value_or(0);
  }
  return pid > 0 ? std::optional(pid) : std::nullopt;
}

bool is_alive(pid_t pid) { return ::kill(pid, 0) == 0 || errno == EPERM; }

// The process that has this lock, where it is another one and lives.
std::optional<UucpHolder> holder_of(const std::string& file) {
  const std::optional<pid_t> pid = pid_in(beginning_of(file));
  if (!pid || *pid == ::getpid() || !is_alive(*pid)) return std::nullopt;
  UucpHolder holder{.file = file, .pid = *pid};
  const std::string name = beginning_of(fmt::format("/proc/{}/comm", *pid));
  holder.program = name.substr(0, name.rfind('\n'));
  return holder;
}

// The device's own first: it is the one that other programs know.
std::vector<std::string> lock_files(const std::string& folder, const std::string& device,
                                    const std::string& devices) {
  std::vector<std::string> files;
  std::error_code error;
  const fs::path real = fs::canonical(device, error);
  const bool counts = fs::absolute(device, error).lexically_normal().string().starts_with(devices + "/");
  for (const fs::path& name : {real, counts ? fs::path(device) : fs::path()}) {
    std::string file = folder + "/LCK.." + name.filename().string();
    if (!name.empty() && std::ranges::find(files, file) == files.end()) files.push_back(std::move(file));
  }
  return files;
}

std::string folder_of(const std::string& file) { return fs::path(file).parent_path().string(); }

Error not_made(const std::string& place, int error_number) {
  return make_error(Errc::io, fmt::format("no lock can be made: {}: {}; other programs are not told that the "
                                          "device is in use",
                                          in_quotes(place), errno_text(error_number)));
}

std::string temporary_lock(const std::string& folder) {
  std::random_device random;
  return fmt::format("{}/LTMP.{}.{:08x}", folder, ::getpid(), random());
}

// A file of its own with our number, which becomes a lock by a link(): that fails where there is one.
Result<UniqueFd> write_number(const std::string& path) {
  UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (!fd) return not_made(folder_of(path), errno);
  const std::string number = fmt::format("{:>10}\n", ::getpid());
  errno = 0;
  const bool written = ::write(fd.get(), number.data(), number.size()) == static_cast<ssize_t>(number.size());
  // Whatever our umask is, others are to read it.
  if (written && ::fchmod(fd.get(), 0644) == 0) return fd;
  const int error = errno != 0 ? errno : ENOSPC;
  (void)::unlink(path.c_str());
  return not_made(folder_of(path), error);
}

// Takes a lock out of the way that was a dead process's when we looked; one that is not by now comes back.
void put_away(const std::string& file, const std::string& aside) {
  if (std::rename(file.c_str(), aside.c_str()) != 0) return;
  if (holder_of(aside)) (void)::link(aside.c_str(), file.c_str());
  (void)::unlink(aside.c_str());
}

Result<void> make_lock(const std::string& file, const std::string& number, const std::string& aside) {
  constexpr int kTries = 3;  // others may make theirs at the same time
  int error = EEXIST;
  for (int n = 0; n < kTries; ++n) {
    if (::link(number.c_str(), file.c_str()) == 0) return {};
    error = errno;
    if (error != EEXIST) break;
    if (const auto holder = holder_of(file)) return make_error(Errc::device_missing, to_text(*holder));
    if (!pid_in(beginning_of(file))) break;  // who knows what it is
    put_away(file, aside);
  }
  return not_made(file, error);
}

}  // namespace

std::optional<UucpHolder> uucp_holder(const std::string& folder, const std::string& device,
                                      const std::string& devices) {
  for (const std::string& file : lock_files(folder, device, devices)) {
    if (auto holder = holder_of(file)) return holder;
  }
  return std::nullopt;
}

std::string to_text(const UucpHolder& holder) {
  const std::string program = holder.program.empty() ? "" : fmt::format(" ({})", in_quotes(holder.program));
  return fmt::format(
      "process {}{} has it, says {}: end that program, or remove the file if it does not use the "
      "device any more",
      holder.pid, program, in_quotes(holder.file));
}

Result<UucpLock> UucpLock::take(const std::string& folder, const std::string& device,
                                const std::string& devices) {
  const std::string number = temporary_lock(folder);
  Result<UniqueFd> written = write_number(number);
  if (!written) return written.error();
  UucpLock lock;
  lock.lock_ = std::move(*written);
  Result<void> made;
  for (const std::string& file : lock_files(folder, device, devices)) {
    made = make_lock(file, number, number + ".old");
    if (!made) break;
    lock.files_.push_back(file);
  }
  (void)::unlink(number.c_str());
  if (!made) return made.error();
  return lock;
}

UucpLock::~UucpLock() {
  for (const std::string& file : files_) (void)remove_if_same(AT_FDCWD, file, lock_.get());
}

}  // namespace porttape
