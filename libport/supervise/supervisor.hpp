#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/supervise/call.hpp"
#include "libport/supervise/call_filter.hpp"
#include "libport/supervise/kept_call.hpp"
#include "libport/supervise/kept_calls.hpp"
#include "libport/supervise/known_threads.hpp"

namespace porttape {

class Supervisor;

// One thing that the supervisor does with calls. The parts are asked in turn.
class CallPart {
 public:
  virtual ~CallPart() = default;
  [[nodiscard]] virtual std::vector<CallTrap> traps() const = 0;

  struct NotMine {};
  struct Kept {};  // keep() of the supervisor was called for it
  using Decision = std::variant<NotMine, Kept, Outcome>;
  virtual Decision decide(Supervisor& supervisor, const Call& call) = 0;
};

// Answers the trapped calls of the programs behind one listener (trap_calls()), on a loop. What no part wants
// is passed. Owns the listener; destroyed before the programs have ended, their trapped calls fail with
// ENOSYS, so that they are to be ended first. Loop thread only.
class Supervisor {
 public:
  // Kept calls are called back by the clock of the loop.
  Supervisor(Loop& loop, UniqueFd listener, std::vector<std::unique_ptr<CallPart>> parts);
  ~Supervisor();
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  // For a part, within decide().
  std::shared_ptr<KeptCall> keep(const Call& call);
  // The same for a call that gives EINTR after a signal whatever the handler has, as the kernel's waits for
  // what is to be sent do.
  std::shared_ptr<KeptCall> keep_until_signal(const Call& call);

  // What is to be trapped for these parts and for the supervisor itself.
  static std::vector<CallTrap> traps(const std::vector<std::unique_ptr<CallPart>>& parts);

 private:
  // Whom we answer mostly runs at once, in our place, and has made its next call when we go on: taken without
  // a turn of the loop. So many, some 100 µs, before the loop's other events have theirs.
  static constexpr int kInARow = 8;
  static constexpr std::size_t kManyKept = 100;

  void on_readable();
  void all_gone();
  void take_one();
  void handle(const Call& call);
  std::optional<Outcome> install_file(std::uint64_t id, const outcome::Install& install);
  void send(const Call& call, Outcome outcome);

  UniqueFd listener_;
  std::vector<std::unique_ptr<CallPart>> parts_;
  bool calls_stay_;
  KnownThreads threads_;
  std::vector<std::byte> told_;  // room for a notification of this kernel
  std::vector<std::byte> response_;
  KeptCalls kept_;
  FdWatch watch_;
};

}  // namespace porttape
