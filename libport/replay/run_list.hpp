#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "libport/replay/report.hpp"

namespace porttape {

// Whether the driver wrote nothing though the tape expects writes: a `stty` or a probe, which is no run.
bool is_look(const RunReport& report);

// The runs of a replay in the order of their ends, and which of them a program goes by: the worst. Looks are
// counted and are no runs. A plain value; memory is bounded.
class RunList {
 public:
  static constexpr std::size_t kMostListed = 1000;

  // The complete report of a run that has ended, of a look, or of a run that nobody began. Of one of several
  // connections the last two are runs too, and incomplete. One that comes again takes the place of the
  // latest.
  void add(const RunReport& report);

  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] std::uint64_t looks() const { return looks_; }

  // Returns the report of the worst run, the first of equals. If there was no run, it returns that of the
  // latest look or of nobody's run, with the verdict `incomplete`; nullopt if there was not even that.
  [[nodiscard]] const std::optional<RunReport>& worst() const { return worst_ ? worst_ : none_; }
  // The same of the latest.
  [[nodiscard]] const std::optional<RunReport>& latest() const { return latest_ ? latest_ : none_; }

  // The value of `runs` in a report.
  [[nodiscard]] std::string json() const;
  // For a person: "3 runs, the worst: data-mismatch; 1 look".
  [[nodiscard]] std::string text() const;

 private:
  void add_run(const RunReport& run);

  std::uint64_t count_ = 0;
  std::uint64_t looks_ = 0;
  std::optional<RunReport> worst_;
  std::optional<RunReport> latest_;
  bool worst_is_latest_ = false;
  std::optional<RunReport> none_;
  std::deque<std::string> listed_;  // JSON objects
};

// The report of contract section 6 with the runs: the latest run's, whose `exit` is what a program ends with
// that ends now. Empty while nothing was added.
std::string to_json(const RunList& runs);

}  // namespace porttape
