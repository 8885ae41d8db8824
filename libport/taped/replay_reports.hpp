#pragma once

#include <atomic>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

#include "libport/base/workers.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/run_list.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/played_tape.hpp"

namespace porttape {

// The way of each run's report from the end of the run to those who read it. What may take long is done on
// other threads, by readers of their own: counting the tape, checking it by its digests, looking for where
// the bytes of a mismatch stand elsewhere, finding the cause (diagnose()), writing the file. A report waits
// for count, check, hint and cause, but not longer than the limits below, and then says what is missing, or
// has no cause; the line waits for nothing.
//
// Drive it: begin_count() when a run begins, look_for_hint() for each mismatch, add() at the end of a run,
// and finish() once. Loop thread only. Destroying it gives up what is under way.
class ReplayReports {
 public:
  static constexpr Nanos kCountLimit = std::chrono::seconds(5);
  static constexpr Nanos kHintLimit = std::chrono::seconds(1);
  static constexpr Nanos kFileTime = std::chrono::seconds(1);
  static constexpr std::size_t kMostHints = 8;  // a run

  // Of several tapes that are played together, for one file.
  struct Group {
    RunList runs;
    std::vector<Doubt> doubts;  // of them all, which the next one has
    mode_t kept = 0;            // from others, by any of the tapes
    Workers::Strand file_strand;
  };

  struct Options {
    TapePaths tape;
    std::string file;                   // for the latest run and the list of all, or empty
    std::string junit_file;             // for the worst run as a test, or empty
    std::optional<TapeTotals> totals;   // if known without counting
    PlayedAs as = {};                   // what of the tape, and by whom
    TapeTime start = {};                // from there on
    bool unchecked = false;             // check_tape() is still to be asked
    std::shared_ptr<Group> group = {};  // whose runs the file is to have; null: these alone
  };
  // In the order of the runs; the file follows.
  using Publish = std::function<void(const RunReport&)>;

  ReplayReports(const PortContext& context, Options options, Publish publish);
  ~ReplayReports();

  // Counts the tape and checks it, unless that is done, given up or under way.
  void begin_count();
  void look_for_hint(const Mismatch& mismatch);
  void add(RunReport report);

  // Gives the doubts of the group that came after its last run to that run: its report, published, follows
  // once more (RunReport::again). There is such a run, and none goes on.
  void add_late_doubts();

  // Adds a doubt that came to be known after the last run, to that run's report. Published already, that
  // follows once more (RunReport::again). For tapes without a group.
  void add_late_doubt(Doubt doubt);

  // Calls `done` once all reports are published and the file is written, or at `limit` (count and hint are
  // given up kFileTime before); whether the file could be written. No report may be added then.
  void finish(Instant limit, std::function<void(bool written)> done);

  // Of the reports published.
  [[nodiscard]] const RunList& runs() const { return runs_; }

 private:
  struct Job;
  struct Count;
  struct Checking;
  struct Search;
  struct Diagnosing;
  struct Waiting {
    RunReport report;
    std::shared_ptr<Search> search = {};  // for the report's mismatch
    Instant ended{};
    std::optional<Instant> settled = {};  // since then its verdict is known
    std::shared_ptr<Diagnosing> diagnosing = {};
  };

  [[nodiscard]] bool run(const Workers::Strand& strand, const std::shared_ptr<Job>& job,
                         std::function<void()> work, std::function<void()> done);
  void hint_found(const Search& search);
  void move_on();
  void publish(RunReport report);
  bool complete(Waiting& waiting, Instant now);
  void begin_check();
  bool settle(Waiting& waiting, Instant now);
  void add_check(RunReport& report) const;
  bool has_hint(Waiting& waiting, Instant now);
  void begin_diagnosis(Waiting& waiting, Instant now);
  bool has_diagnosis(Waiting& waiting, Instant now);
  [[nodiscard]] bool late(Instant limit, Instant now) const;
  void write_file();
  void file_written(const Result<void>& written);
  void set_timer();

  PortContext context_;
  Options options_;
  Publish publish_;
  Workers::Strand count_strand_;
  Workers::Strand check_strand_;
  Workers::Strand hint_strand_;
  Workers::Strand diagnosis_strand_;
  Workers::Strand file_strand_;
  mode_t kept_ = 0;  // from others, by the tape
  std::shared_ptr<Count> count_;
  std::shared_ptr<Checking> check_;
  std::deque<std::shared_ptr<Search>> searches_;  // of the run that goes on
  std::deque<Waiting> waiting_;
  bool file_under_way_ = false;
  bool file_outdated_ = false;  // to be written again after that
  bool file_failed_ = false;
  RunList runs_;
  std::optional<Instant> limit_;
  std::function<void(bool)> done_;
  Timer timer_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

}  // namespace porttape
