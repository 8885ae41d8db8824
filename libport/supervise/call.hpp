#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <sys/types.h>

#include "libport/base/tty_device.hpp"
#include "libport/base/unique_fd.hpp"

struct seccomp_notif;

namespace porttape {

class KnownThreads;

// A system call that a supervised thread waits in, before the kernel has done anything of it. A value; the
// thread may be gone at any time, and its memory with it.
class Call {
 public:
  // Both outlive it. `stays`: only its thread's end can end it before it is answered.
  Call(int listener, KnownThreads& threads, const seccomp_notif& told, bool stays);

  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] pid_t thread() const { return thread_; }
  [[nodiscard]] int number() const { return number_; }  // that of a 64-bit program; -1: no such
  [[nodiscard]] std::uint64_t argument(std::size_t index) const { return arguments_.at(index); }
  // Whose pointers and some structs are those of 32 bits.
  [[nodiscard]] bool is_small() const { return small_; }

  // Whether the thread still waits in it. What was read or opened by the thread's number before counts only
  // then: numbers are used again.
  [[nodiscard]] bool waits() const;
  // For one that is answered later: what was seen of its thread up to now counts no more.
  [[nodiscard]] Call for_later() const;

  // Returns the device that the thread has open as `fd`, or nullopt if that is not a device. If it is
  // /dev/tty, the device is the terminal that was meant when it was opened, of which only the number is
  // known.
  [[nodiscard]] std::optional<TtyDevice> device_of(int fd) const;

  // A descriptor of ours for that same open file; nothing where that is forbidden, or there is none.
  [[nodiscard]] UniqueFd duplicate(int fd) const;
  // Whether its thread has as `fd` the open file that we have as `ours`. False also where the kernel does not
  // say.
  [[nodiscard]] bool has_as(int fd, int ours) const;

  // Its memory, whole or not at all. False: that address is not the program's, or must not be reached.
  bool read(std::uint64_t address, std::span<std::byte> into) const;
  bool write(std::uint64_t address, std::span<const std::byte> what) const;
  // Whether nobody without rights may look into its process: prctl(2), PR_SET_DUMPABLE.
  [[nodiscard]] bool is_closed() const;
  // A path there, as the kernel would read it; nothing where it is not the program's or too long.
  [[nodiscard]] std::optional<std::string> read_path(std::uint64_t address) const;
  template <class T>
  std::optional<T> read_as(std::uint64_t address) const {
    T value{};
    if (!read(address, std::as_writable_bytes(std::span(&value, 1)))) return std::nullopt;
    return value;
  }
  template <class T>
  bool write_as(std::uint64_t address, const T& value) const {
    return write(address, std::as_bytes(std::span(&value, 1)));
  }

 private:
  [[nodiscard]] UniqueFd duplicate_by_thread(int fd) const;

  int listener_;
  KnownThreads* threads_;
  std::uint64_t id_;
  pid_t thread_;
  int number_;
  bool small_;
  bool stays_;
  mutable bool seen_ = false;  // its thread was there just now
  std::array<std::uint64_t, 6> arguments_{};
};

}  // namespace porttape
