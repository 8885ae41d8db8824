#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// A process as /proc shows it. A /proc of an outer PID namespace, as a container may have, has other numbers
// than ours.
struct ProcessState {
  pid_t pid = 0;     // for our system calls
  pid_t number = 0;  // in /proc
  pid_t parent = 0;  // in /proc
  char state = '?';  // R, S, D, T (stopped), t (stopped by its tracer), Z (ended, not reaped)
  std::uint64_t cpu_ticks = 0;
  std::uint64_t started = 0;  // with `number` the identity of a process
  std::string name;
};

// The content of /proc/PID/stat: all but `pid`. False when it is not of its form.
bool parse_process_stat(std::string_view text, ProcessState& process);
// Reads the numbers of a process in each PID namespace, from that of /proc to its own (`NSpid`), from the
// content of /proc/PID/status. The result is empty if the line is missing.
std::vector<pid_t> numbers_of_process(std::string_view status);

// The processes that descend from the commands which this process starts after adopt(), also those whose
// parent has ended: they fall to us. What was our child before is none of them and is never touched. One at a
// time in a process.
class CommandFamily {
 public:
  CommandFamily() = default;
  ~CommandFamily();
  CommandFamily(const CommandFamily&) = delete;
  CommandFamily& operator=(const CommandFamily&) = delete;

  // From now on orphans fall to this process, until destroyed. Before the first command.
  Result<void> adopt();

  // A child of ours that is none of them, nor is what descends from it while it lives.
  void spare(pid_t child);

  // A child of ours that is none of them, though what descends from it is.
  void look_through(pid_t child);

  // Returns the processes that exist now, ended ones that nobody has reaped among them. Reads all of /proc.
  // The result is empty if /proc belongs to a PID namespace that does not show this process.
  [[nodiscard]] std::vector<ProcessState> members() const;

  // Whether one of them runs, waits for a disk, is stopped or traced, or took more than 2 % of a processor
  // since the last call, a second ago.
  [[nodiscard]] bool awake();

  // Whether one of them is traced, as under a debugger.
  [[nodiscard]] bool debugged() const;

  // Ends and reaps them all: SIGTERM, after `term_limit` SIGKILL, and `kill_limit` later it gives up. Waits
  // for it; returns at once if this process has no children. A process gets a signal only if it
  // certainly descends from a command. Processes that fork and leave, again and again, are caught too: before
  // they are found in /proc they are gone, but each of them becomes our child.
  struct Ended {
    std::vector<ProcessState> ended;
    std::vector<ProcessState> left;  // still there: another user's, or held by the kernel
    // Whether processes are left that /proc does not show. It is false if this process has other children
    // too, since those cannot be told apart then.
    bool unseen = false;
  };
  Ended end(Nanos term_limit, Nanos kill_limit);
  // For what a command, or a worker that died, leaves running.
  static constexpr Nanos kTermLimit = std::chrono::seconds(2);
  static constexpr Nanos kKillLimit = std::chrono::seconds(1);

 private:
  using Picture = std::map<pid_t, ProcessState>;  // by the numbers in /proc
  [[nodiscard]] bool is_ours(const ProcessState& process, const Picture& everybody, pid_t self) const;
  [[nodiscard]] std::vector<ProcessState> living() const;
  [[nodiscard]] bool is_spared(pid_t child) const;
  // Our children now that are the commands' or descend from them, by the numbers in /proc.
  [[nodiscard]] std::vector<pid_t> own_children() const;
  // Signals those that were not signalled before, and reaps those that were, until no new one comes. The
  // result is false if they come for a quarter of a second or longer.
  bool chase(int signal, std::map<pid_t, int>& signalled, std::vector<ProcessState>& ended) const;

  int was_adopting_ = 0;
  bool adopting_ = false;
  bool others_ = false;  // children of ours that are none of them
  // By the numbers in /proc.
  std::optional<ProcessState> looked_through_;
  std::map<pid_t, std::uint64_t> before_;     // our children from before: when each was started
  std::map<pid_t, std::uint64_t> cpu_ticks_;  // at the last awake()
};

}  // namespace porttape
