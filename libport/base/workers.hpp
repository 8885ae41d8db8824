#pragma once

#include <functional>
#include <memory>

#include "libport/base/time.hpp"

namespace porttape {

// Threads for work that may wait or take long: a disk, a close, a count. Owns the threads and the jobs.
//
// Jobs of one Strand run one after another, in the order they were posted. One thread serves all strands
// while jobs return; a job that waits behind others for a moment (10 ms) gets a thread of its own
// (at most 64), so a job that hangs holds up its own strand alone. Threads start with the first post().
//
// The queue of jobs is not bounded here: who posts keeps at most a few under way. The destructor drops the
// jobs that have not begun and waits a moment (50 ms) for those that have; one that hangs is left to itself,
// so a job must own what it uses. A job must not throw. Any thread may call.
class Workers {
 public:
  class Strand {
   public:
    Strand();

   private:
    friend class Workers;
    struct State;
    std::shared_ptr<State> state_;
  };

  Workers();
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  // False when no thread is there and none can be had (limits): the job was not taken and will not run.
  [[nodiscard]] bool post(const Strand& strand, std::function<void()> job);
  // The same, not before `when` by the machine's clock.
  [[nodiscard]] bool post_at(Instant when, const Strand& strand, std::function<void()> job);

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
