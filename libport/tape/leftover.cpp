#include "libport/tape/leftover.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdint>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>

#include "libport/base/trusted_folder.hpp"
#include "libport/tape/signals_held.hpp"

namespace porttape {
namespace {

struct LeftoverSlot {
  std::atomic<bool> taken = false;
  std::atomic<bool> is_set = false;  // the path is whole
  std::array<char, PATH_MAX> path{};
};

// A signal handler finds what it needs only here.
std::array<LeftoverSlot, Leftover::kMost> leftover_slots;
std::atomic<pid_t> leftover_process = 0;

// As getdents64() gives it.
struct DirectoryEntry {
  std::uint64_t inode;
  std::int64_t offset;
  std::uint16_t length;
  std::uint8_t type;
  char name[1];
};

// Only calls that a signal handler may make.
void empty_folder(const char* path) {
  const int folder = ::open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (folder < 0) return;
  alignas(DirectoryEntry) std::array<char, 4096> entries{};
  for (;;) {
    const long size = ::syscall(SYS_getdents64, folder, entries.data(), entries.size());
    if (size <= 0) break;
    for (long at = 0; at < size;) {
      const auto* const entry = reinterpret_cast<const DirectoryEntry*>(entries.data() + at);
      (void)::unlinkat(folder, entry->name, 0);  // "." and ".." are none
      at += entry->length;
    }
  }
  (void)::close(folder);
}

void remove_leftover(const char* path) {
  if (::unlink(path) == 0 || (errno != EISDIR && errno != EPERM)) return;
  empty_folder(path);
  (void)::rmdir(path);
}

extern "C" void remove_leftovers(int number) {
  const int error = errno;
  if (::getpid() == leftover_process.load()) {
    for (const LeftoverSlot& slot : leftover_slots) {
      if (slot.is_set.load()) remove_leftover(slot.path.data());
    }
  }
  (void)::signal(number, SIG_DFL);
  (void)::raise(number);  // comes when this returns
  errno = error;
}

// Once a process; what its parent has is not its.
void handle_signals() {
  for (LeftoverSlot& slot : leftover_slots) {
    slot.is_set = false;
    slot.taken = false;
  }
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction now {};
    if (::sigaction(number, nullptr, &now) != 0 || now.sa_handler != SIG_DFL) continue;
    struct sigaction ours {};
    ours.sa_handler = remove_leftovers;
    // As by default only when all is away: a second one must not end the work of the first.
    ::sigemptyset(&ours.sa_mask);
    for (const int other : {SIGINT, SIGTERM, SIGHUP}) ::sigaddset(&ours.sa_mask, other);
    (void)::sigaction(number, &ours, nullptr);
  }
}

// kMost: none is free, or it is too long.
std::size_t take_slot(const std::string& path) {
  if (leftover_process.exchange(::getpid()) != ::getpid()) handle_signals();
  if (path.size() >= PATH_MAX) return Leftover::kMost;
  for (std::size_t i = 0; i < leftover_slots.size(); ++i) {
    LeftoverSlot& slot = leftover_slots.at(i);
    if (slot.taken.exchange(true)) continue;
    std::memcpy(slot.path.data(), path.c_str(), path.size() + 1);
    slot.is_set = true;
    return i;
  }
  return Leftover::kMost;
}

}  // namespace

Leftover::Leftover(std::string path) : path_(std::move(path)), slot_(take_slot(path_)) {}

Leftover Leftover::make_folder(int folder, const std::string& its_path, const std::string& prefix) {
  const SignalsHeld held;
  const std::string name = make_private_folder(folder, prefix);
  if (name.empty()) return {};
  return Leftover((std::filesystem::path(its_path) / name).string());
}

Leftover::Leftover(Leftover&& other) noexcept
    : path_(std::exchange(other.path_, {})), slot_(std::exchange(other.slot_, kMost)) {}

Leftover& Leftover::operator=(Leftover&& other) noexcept {
  if (this == &other) return *this;
  remove();
  path_ = std::exchange(other.path_, {});
  slot_ = std::exchange(other.slot_, kMost);
  return *this;
}

void Leftover::remove() {
  if (!path_.empty()) remove_leftover(path_.c_str());
  keep();
}

void Leftover::keep() {
  if (slot_ < kMost) {
    leftover_slots.at(slot_).is_set = false;
    leftover_slots.at(slot_).taken = false;
  }
  path_.clear();
  slot_ = kMost;
}

}  // namespace porttape
