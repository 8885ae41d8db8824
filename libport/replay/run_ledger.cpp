#include "libport/replay/run_ledger.hpp"

#include <chrono>

namespace porttape {
namespace {

double in_us(Nanos time) { return static_cast<double>(time.count()) / 1000.0; }

}  // namespace

void RunLedger::mismatch(const Mismatch& mismatch) {
  ++mismatches_;
  std::optional<Mismatch>& first = mismatch.kind == MismatchKind::timing ? first_timing_ : first_data_;
  if (!first) first = mismatch;
}

Micros RunLedger::since_begin(Instant now) const { return std::chrono::floor<Micros>(now - begun_); }

// Data and extra outrank what is missing, which outranks timing: `timing-mismatch` means that all else was
// right.
RunReport RunLedger::report(const ReplayConfig& config, Instant now, bool unsent) const {
  RunReport report;
  report.strictness = config.strictness;
  report.timing = config.timing;
  report.rate = config.rate;
  report.duration = now - begun_;
  report.to_driver_bytes = to_driver_;
  report.from_driver_bytes = from_driver_;
  report.mismatches = mismatches_;
  report.timer_late_p50_us = in_us(lateness_.quantile(0.5));
  report.timer_late_p99_us = in_us(lateness_.quantile(0.99));
  report.timer_late_max_us = in_us(lateness_.max());
  report.mismatch = first_data_ ? first_data_ : first_timing_;
  const bool stopped = config.on_mismatch == OnMismatch::fail && first_timing_;
  if (config.strictness == 0) {
    report.verdict = Verdict::pass;
  } else if (first_data_) {
    report.verdict = first_data_->kind == MismatchKind::extra ? Verdict::extra : Verdict::data_mismatch;
  } else if (unsent && !stopped) {
    report.verdict = Verdict::incomplete;
  } else if (first_timing_) {
    report.verdict = Verdict::timing_mismatch;
  }
  return report;
}

}  // namespace porttape
