#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <signal.h>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "tools/command_family.hpp"
#include "tools/job_worker.hpp"

namespace porttape {

// Jobs done in worker processes, several at a time: each worker is forked when it is first needed, with all
// that this process knows then, and does job after job. One that dies is told as its job's trouble, the
// commands that it had are ended, and another takes its place.
//
// Drive it: add(), then wait() until it gives nothing; add() again at any time. While a pool lives, this
// process has no thread beside the one that uses it (a fork would lose them), runs no command itself, and
// SIGINT, SIGTERM, SIGHUP and SIGQUIT, as far as they are not ignored, are the pool's: the first goes to the
// workers, which end their commands, a second one kills them all; nothing is begun then any more.
class JobPool {
 public:
  struct Options {
    std::size_t workers = 1;
    JobWork work;
    std::optional<Nanos> limit = {};  // for each job; none: what it runs has its own limits
  };

  // Errc::io: there are no descriptors left.
  static Result<std::unique_ptr<JobPool>> make(Options options);
  ~JobPool();  // as cancel(), and ends the workers; what they left is ended too
  JobPool(const JobPool&) = delete;
  JobPool& operator=(const JobPool&) = delete;

  // The number of the job: 0, 1, 2, … They are begun in this order.
  std::size_t add(std::string job);
  // Waits for the next one that ends; none when none is left. With `until` it gives none then, too.
  std::optional<JobDone> wait(std::optional<Instant> until = {});
  // Forgets the jobs that have not begun, and ends those that have: wait() tells of none of them.
  void cancel();

  [[nodiscard]] std::size_t waiting() const { return waiting_.size(); }
  [[nodiscard]] std::size_t running() const;
  // A signal of the user's, who wants it all to end; 0: none came.
  [[nodiscard]] int interrupted_by() const { return signal_; }

 private:
  struct Job {
    std::size_t number = 0;
    std::string text;
  };

  explicit JobPool(Options options);
  Result<void> watch_signals();
  void give_jobs();
  JobWorker* idle_worker();
  void poll_all(std::optional<Instant> until);
  void look_at_all();
  void take_signal();
  void replace_gone();
  void end_all();

  Options options_;
  sigset_t signals_ = {};
  sigset_t before_ = {};
  UniqueFd signal_fd_;
  CommandFamily family_;  // what fell to us from workers that died
  std::deque<Job> waiting_;
  std::deque<JobDone> done_;
  std::vector<std::unique_ptr<JobWorker>> workers_;
  std::string refused_;  // why no worker could be started
  std::size_t added_ = 0;
  std::size_t told_from_ = 0;  // earlier ones were cancelled
  int signal_ = 0;
};

}  // namespace porttape
