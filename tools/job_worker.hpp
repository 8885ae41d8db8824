#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <poll.h>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "tools/bounded_text.hpp"

namespace porttape {

// Done in a worker process: a job, and what came of it. What it throws is told as its trouble.
using JobWork = std::function<std::string(const std::string& job)>;

// A job that has ended.
struct JobDone {
  std::size_t job = 0;       // as JobPool::add() numbered it
  std::string result = {};   // what the work gave
  std::string output = {};   // what it and its commands wrote to stdout and stderr, BoundedText
  std::string trouble = {};  // why there is no result, for a person; else empty
};

// One worker process as its parent has it: it waits for a job, does it, hands back the result and waits for
// the next one. It ends when its JobWorker goes, and is asked to when the parent dies.
//
// Its stdin is empty; its stdout and stderr, and those of its commands, come to the parent. Nothing here
// waits, except reap() and the destructor. The parent has no thread but its own.
class JobWorker {
 public:
  // Forks. `in_child` closes what of the parent's the new process is not to keep. Errc::io: no process is to
  // be had.
  static Result<std::unique_ptr<JobWorker>> start(const JobWork& work, const std::function<void()>& in_child);
  ~JobWorker();  // kills it, where it has not ended
  JobWorker(const JobWorker&) = delete;
  JobWorker& operator=(const JobWorker&) = delete;

  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] bool busy() const { return job_.has_value(); }
  [[nodiscard]] std::optional<std::size_t> job() const { return job_; }
  [[nodiscard]] bool gone() const { return gone_; }  // has ended, or will not take another job
  // To one that is not busy. It is ended when it is not done by `until`, and `why` is then its trouble.
  void give(std::size_t job, std::string_view text, std::optional<Instant> until, std::string why);

  void add_to(std::vector<pollfd>& polled) const;
  // When something is to be done without an event.
  [[nodiscard]] std::optional<Instant> deadline() const { return deadline_; }
  // Reads and writes what can be, and ends what is late. The job that has ended, if one has.
  std::optional<JobDone> look();

  // No further job: it ends, at once when it does nothing.
  void close();
  // Asks it to end its job, with its commands, and kills it when it has not done so some time later. `why` is
  // the job's trouble.
  void end(int signal_number, std::string why);
  void kill();
  // In the child of another fork: the process is not its to end.
  void forget();
  // Waits for the end of a process that ends, and says how it did.
  std::string reap();

 private:
  JobWorker(pid_t pid, UniqueFd pid_fd, UniqueFd line, UniqueFd output);
  [[nodiscard]] bool has_ended() const;
  void write_some();
  void read_some();
  void read_output();
  std::optional<JobDone> take_done();
  void kill_late();

  pid_t pid_;
  UniqueFd pid_fd_;  // its end; what it started may hold the other two open
  UniqueFd line_;    // jobs there, results back
  UniqueFd output_;  // its stdout and stderr
  std::string outgoing_;
  std::string incoming_;
  BoundedText text_;
  std::optional<std::size_t> job_;
  std::optional<Instant> deadline_;
  std::string late_;  // the trouble of a job that is not done by the deadline
  std::string why_;   // it was asked to end
  bool asked_ = false;
  bool gone_ = false;
};

}  // namespace porttape
