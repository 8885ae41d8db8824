#include "tools/fault_pool.hpp"

#include <stdexcept>
#include <utility>

#include "tools/command_end.hpp"

namespace porttape {

Result<FaultPool> FaultPool::make(const FaultCase& the_case) {
  const auto work = [setup = the_case.setup](const std::string& job) {
    const Result<FaultRunEnd> end = do_fault_run(setup, fault_run_job(job));
    if (!end) throw std::runtime_error(end.error().message);
    return to_text(*end);
  };
  Result<std::unique_ptr<JobPool>> pool = JobPool::make({.workers = the_case.jobs, .work = work});
  if (!pool) return pool.error();
  return FaultPool(std::move(*pool));
}

std::optional<FaultPool::Done> FaultPool::wait(std::optional<Instant> until) {
  std::optional<JobDone> done = pool_->wait(until);
  if (!done) return std::nullopt;
  Done result{.job = done->job, .output = std::move(done->output), .trouble = std::move(done->trouble)};
  if (result.trouble.empty()) result.end = fault_run_end(done->result);
  return result;
}

Result<FaultPool::Done> FaultPool::run(const FaultRunJob& job) {
  add(job);
  std::optional<Done> done = wait();
  if (interrupted_by() != 0) return make_error(Errc::io, "interrupted by " + signal_text(interrupted_by()));
  if (!done) return make_error(Errc::io, "the run was not done");
  if (!done->trouble.empty()) return make_error(Errc::io, done->trouble);
  return std::move(*done);
}

}  // namespace porttape
