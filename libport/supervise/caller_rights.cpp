#include "libport/supervise/caller_rights.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <linux/capability.h>
#include <optional>
#include <sstream>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace porttape {
namespace {

bool is_same_file(const std::string& one, const std::string& other) {
  struct stat first {};
  struct stat second {};
  return ::stat(one.c_str(), &first) == 0 && ::stat(other.c_str(), &second) == 0 &&
         first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

// Nothing: that is not to be known.
std::optional<std::uint64_t> mount_of(const std::string& file) {
  struct statx status {};
  if (::statx(AT_FDCWD, file.c_str(), 0, STATX_MNT_ID, &status) != 0 || (status.stx_mask & STATX_MNT_ID) == 0)
    return std::nullopt;
  return status.stx_mnt_id;
}

// One folder may be mounted twice, with other rules (no devices, nothing to be written).
bool is_same_place(const std::string& one, const std::string& other) {
  const std::optional<std::uint64_t> mount = mount_of(one);
  return mount && mount == mount_of(other) && is_same_file(one, other);
}

// A kernel without them (CONFIG_USER_NS) shows none.
bool has_user_namespaces() {
  struct stat status {};
  return ::stat("/proc/thread-self/ns/user", &status) == 0 || errno != ENOENT;
}

// What a security module knows it as; empty without one, and of a profile that restricts nothing.
std::string label_of(const std::string& folder) {
  std::string label;
  std::ifstream file(folder + "attr/current");
  std::getline(file, label);
  while (!label.empty() && label.back() == '\0') label.pop_back();
  return label == "unconfined" || label.ends_with(" (unconfined)") ? std::string() : label;
}

// What the kernel says of a thread.
class ThreadRights {
 public:
  explicit ThreadRights(const std::string& thread) {
    std::ifstream file(fmt::format("/proc/{}/status", thread));
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with("Uid:")) user_ = id_for_files(line);
      if (line.starts_with("Gid:")) group_ = id_for_files(line);
      if (line.starts_with("Groups:")) groups_ = numbers_of(line, 10);
      if (line.starts_with("CapEff:")) capabilities_ = numbers_of(line, 16);
    }
    std::ranges::sort(groups_);
  }

  [[nodiscard]] bool known() const { return user_ && group_ && capabilities_.size() == 1; }
  [[nodiscard]] bool has(unsigned capability) const {
    return known() && ((capabilities_.front() >> capability) & 1U) != 0;
  }
  // Whether it may all that the other may, as the same user.
  [[nodiscard]] bool equals(const ThreadRights& other) const {
    return known() && other.known() && user_ == other.user_ && group_ == other.group_ &&
           groups_ == other.groups_ && (other.capabilities_.front() & ~capabilities_.front()) == 0;
  }

 private:
  using Numbers = std::vector<unsigned long>;
  static Numbers numbers_of(const std::string& line, int base) {
    std::istringstream text(line.substr(line.find(':') + 1));
    Numbers numbers;
    for (std::string word; text >> word;) numbers.push_back(std::strtoul(word.c_str(), nullptr, base));
    return numbers;
  }
  // The one that counts for files is the last of four.
  static std::optional<unsigned long> id_for_files(const std::string& line) {
    const Numbers ids = numbers_of(line, 10);
    return ids.size() == 4 ? std::optional(ids.back()) : std::nullopt;
  }

  std::optional<unsigned long> user_;
  std::optional<unsigned long> group_;
  Numbers groups_;
  Numbers capabilities_;
};

std::string folder_of(pid_t thread) { return fmt::format("/proc/{}/", thread); }

}  // namespace

std::string why_not_ours(pid_t thread) {
  if (!ThreadRights(std::to_string(thread)).equals(ThreadRights("thread-self")))
    return "it has not the rights that porttape has";
  const std::string folder = folder_of(thread);
  // The capabilities of a user namespace count for what belongs to that namespace alone.
  if (has_user_namespaces() && !is_same_file(folder + "ns/user", "/proc/thread-self/ns/user"))
    return "its rights are those of another user namespace";
  if (label_of(folder) != label_of("/proc/thread-self/"))
    return "a security module gives it other rights than porttape";
  if (!is_same_file(folder + "ns/mnt", "/proc/thread-self/ns/mnt") ||
      !is_same_place(folder + "root", "/proc/thread-self/root"))
    return "the files that it sees are others";
  return {};
}

std::vector<pid_t> lineage_of(pid_t thread) {
  std::vector<pid_t> lineage;
  for (pid_t next = thread; next > 1;) {
    std::ifstream file(fmt::format("/proc/{}/status", next));
    pid_t process = 0;
    pid_t parent = 0;
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with("Tgid:")) process = std::atoi(line.c_str() + 5);
      if (line.starts_with("PPid:")) parent = std::atoi(line.c_str() + 5);
    }
    if (process > 0) lineage.push_back(process);
    next = parent;
  }
  return lineage;
}

bool is_administrator(pid_t thread) {
  return ThreadRights(std::to_string(thread)).has(CAP_SYS_ADMIN) &&
         is_same_file(folder_of(thread) + "ns/user", "/proc/thread-self/ns/user");
}

}  // namespace porttape
