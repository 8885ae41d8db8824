#pragma once

#include <cstdint>
#include <sys/types.h>

namespace porttape {

// The signals that would interrupt a call of this thread: sent to it, or to its process (where several
// threads could take one, each shows it), neither blocked nor ignored. Bit N - 1 is signal N. 0 also for a
// thread that is gone.
struct PendingSignals {
  std::uint64_t of_thread = 0;
  std::uint64_t of_process = 0;
};
PendingSignals pending_signals(pid_t thread);

// The process that the thread is of; 0: it is gone.
pid_t process_of(pid_t thread);

}  // namespace porttape
