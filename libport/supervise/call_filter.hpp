#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A system call that the supervisor is to see: of any file, and where requests are named (ioctl) only with
// one of these as its second argument.
struct CallTrap {
  int number = 0;
  std::vector<std::uint32_t> requests = {};
  // Only where the first argument is a descriptor from this number on, or one of the three standard ones.
  std::optional<std::uint32_t> files_from = {};
  bool or_second = false;  // or the second one is
  // Not where this argument has all bits of one of these masks. A signal can end a call only before it is
  // received, so that the best trap is none.
  struct Flags {
    std::size_t argument = 0;
    std::vector<std::uint32_t> masks = {};
    friend bool operator==(const Flags&, const Flags&) = default;
  };
  Flags unless = {};

  friend bool operator==(const CallTrap&, const CallTrap&) = default;
};

// Makes every later call of this process and of what it starts, that is one of `traps`, wait for the one who
// holds the returned descriptor (seccomp's user notification, seccomp_unotify(2)); the rest goes on as ever.
// Cannot be taken back. For the process that is about to exec a command; sets no_new_privs, which a setuid
// program of that command runs without its rights for.
//
// Calls of 32-bit programs are trapped by their own numbers where the machine runs such.
//
// Errc::usage: what forbids it and what to do.
Result<UniqueFd> trap_calls(const std::vector<CallTrap>& traps);

// Whether a trapped call that somebody has received can end before its answer only by the end of its thread
// (Linux 5.19). On an older kernel a signal ends it, and the thread makes it again. False, with errno, where
// it is not.
bool calls_outlast_signals();

// Of a call of a 32-bit program, the number that the same call has for one of 64 bits; else `number`.
int native_call_number(std::uint32_t arch, int number);
bool is_32_bit(std::uint32_t arch);

}  // namespace porttape
