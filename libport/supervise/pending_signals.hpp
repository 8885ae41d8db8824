#pragma once

#include <cstdint>
#include <sys/types.h>

namespace porttape {

// What the kernel tells of a thread (proc(5), /proc/PID/status). Nothing of one that is gone.
struct ThreadStatus {
  char state = '\0';  // as of ps(1): T is stopped, Z has ended
  pid_t process = 0;
  unsigned threads = 0;  // of the process
  pid_t tracer = 0;      // 0: none
  // The signals that wait for the thread alone, and for its process (where each thread shows them), without
  // those that are ignored (a tracer sees these, too); and those that the thread blocks, ignores and catches.
  // Bit N - 1 is signal N.
  std::uint64_t to_thread = 0;
  std::uint64_t to_process = 0;
  std::uint64_t blocked = 0;
  std::uint64_t ignored = 0;
  std::uint64_t caught = 0;
  // How many wait for all processes of the thread's user.
  std::uint64_t queued = 0;

  [[nodiscard]] bool exists() const { return state != '\0'; }
  [[nodiscard]] bool takes_signals() const { return exists() && state != 'Z' && state != 'X'; }
};
ThreadStatus thread_status(pid_t thread);

// Has the kernel look for signals of the thread once its call is answered, also where it has chosen another
// thread for them: only then may the call be answered as interrupted. Done by an interrupt of ptrace(2)'s
// that is taken back at once. False: the thread is traced already, or that is forbidden.
bool have_signals_looked_for(pid_t thread);

// Sends the thread a signal that does nothing unless it is caught, if there is one that it does not catch.
void send_what_does_nothing(pid_t thread, const ThreadStatus& status);

// The process that the thread is of; 0: it is gone.
pid_t process_of(pid_t thread);

}  // namespace porttape
