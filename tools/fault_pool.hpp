#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

#include "libport/base/result.hpp"
#include "tools/fault_case.hpp"
#include "tools/fault_run.hpp"
#include "tools/job_pool.hpp"

namespace porttape {

// A JobPool whose jobs are runs of one case.
class FaultPool {
 public:
  struct Done {
    std::size_t job = 0;
    FaultRunEnd end = {};
    std::string output = {};
    std::string trouble = {};  // it could not be run
  };

  static constexpr Nanos kProgress = std::chrono::milliseconds(200);  // from one line of progress to the next

  static Result<FaultPool> make(const FaultCase& the_case);

  std::size_t add(const FaultRunJob& job) { return pool_->add(to_text(job)); }
  std::optional<Done> wait(std::optional<Instant> until = {});
  // The same for one alone. Errc::io: it could not be run, or a signal came.
  Result<Done> run(const FaultRunJob& job);
  void cancel() { pool_->cancel(); }
  [[nodiscard]] std::size_t waiting() const { return pool_->waiting(); }
  [[nodiscard]] std::size_t running() const { return pool_->running(); }
  [[nodiscard]] int interrupted_by() const { return pool_->interrupted_by(); }

 private:
  explicit FaultPool(std::unique_ptr<JobPool> pool) : pool_(std::move(pool)) {}
  std::unique_ptr<JobPool> pool_;
};

}  // namespace porttape
