#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <signal.h>
#include <string>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"
#include "libport/supervise/supervised_command.hpp"

namespace porttape {

// What the guard and the command tell, a message each (SOCK_SEQPACKET).
struct GuardMessage {
  enum class Kind : std::uint8_t {
    trouble,
    started,  // with the listener: the command is about to exec
    running,  // it has
    exited
  };
  Kind kind = Kind::started;
  SupervisedCommand::Trouble::Stage stage = SupervisedCommand::Trouble::Stage::machinery;
  int number = 0;  // errno, the command's process, its wait status
  std::string text = {};
};

// False: the other end is gone, or the message was not for this version.
bool send_message(int line, const GuardMessage& message, int fd = -1);
// Waits for one; `fd` is what came with it. Nothing: the other end is gone.
std::optional<GuardMessage> receive_message(int line, UniqueFd& fd);

// Closes all descriptors but the standard ones and these. For a process that was just forked.
template <std::size_t N>
void close_others(std::array<int, N> kept) {
  std::ranges::sort(kept);
  unsigned first = STDERR_FILENO + 1;
  for (const int fd : kept) {
    const auto next = static_cast<unsigned>(fd);
    if (next > first) (void)::syscall(SYS_close_range, first, next - 1, 0U);
    first = std::max(first, next + 1);
  }
  (void)::syscall(SYS_close_range, first, ~0U, 0U);
}

// The guard's whole life, in a process that was just forked from another, maybe from one of several threads.
// All signals are blocked; the command gets `mask`. Does not return.
[[noreturn]] void run_guard(UniqueFd line, const SupervisedCommand::Options& options, const sigset_t& mask);

}  // namespace porttape
