#include "libport/replay/run_list.hpp"

#include <utility>

#include "libport/base/error.hpp"
#include "libport/base/json_object.hpp"
#include "libport/replay/report_words.hpp"

namespace porttape {
namespace {

// The first of equals is the worst; data outranks settings, which have the same status, and a doubt none.
bool is_worse(const RunReport& run, const RunReport& worst) {
  const int status = exit_status_of(run);
  const int other = exit_status_of(worst);
  if (status != other) return worse_exit_status(status, other) == status;
  if (run.verdict == worst.verdict && worst.doubts.empty() != run.doubts.empty()) return worst.doubts.empty();
  return worst.verdict == Verdict::settings_mismatch && run.verdict != Verdict::settings_mismatch;
}

}  // namespace

bool is_look(const RunReport& report) {
  const bool wrote = report.from_driver_bytes > 0 || report.mismatch;
  const bool expected = report.from_driver_of ? *report.from_driver_of > 0
                                              : report.undecided_from || !report.next_expected.empty();
  const bool may_look = report.writer == Writer::driver;  // a device that says nothing is missing
  return may_look && !report.nobody_came && !wrote && expected && !report.trouble;
}

void RunList::add(const RunReport& report) {
  const bool look = is_look(report);
  if (look && !report.again) ++looks_;
  if (!look && !report.nobody_came) return add_run(report);
  RunReport none = report;
  none.verdict = Verdict::incomplete;
  if (report.connection) return add_run(none);  // the others do not stand for it
  none_ = std::move(none);
}

void RunList::add_run(const RunReport& run) {
  const bool again = run.again && !listed_.empty();
  const bool was_worst = again && worst_is_latest_;
  if (again) listed_.pop_back();
  if (!again) ++count_;
  latest_ = run;
  worst_is_latest_ = !worst_ || was_worst || is_worse(run, *worst_);
  if (worst_is_latest_) worst_ = run;
  if (listed_.size() == kMostListed) listed_.pop_front();
  listed_.push_back(run_json(run));
}

std::string RunList::json() const {
  JsonList list;
  for (const std::string& run : listed_) list.add_raw(run);
  const std::string_view verdict = worst() ? to_string(worst()->verdict) : to_string(Verdict::incomplete);
  JsonObject runs;
  runs.add("count", count_).add("looks", looks_).add("worst", verdict).add("list", list);
  return runs.str();
}

std::string RunList::text() const {
  std::string text = count_ > 0
                         ? counted(count_, "run") + ", the worst: " + std::string(to_string(worst_->verdict))
                         : "no run, so the verdict is incomplete";
  if (count_ == 0 && looks_ == 0) return text + ": nobody has opened the port";
  if (looks_ > 0) text += "; " + counted(looks_, "look") + " (opened, and nothing written)";
  return text;
}

std::string to_json(const RunList& runs) {
  if (!runs.latest()) return {};
  RunReport report = *runs.latest();
  report.process_exit = exit_status_of(*runs.worst());
  return to_json(report, runs.json());
}

}  // namespace porttape
