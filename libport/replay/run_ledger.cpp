#include "libport/replay/run_ledger.hpp"

#include <algorithm>
#include <chrono>
#include <string>

#include "libport/tape/event.hpp"

namespace porttape {
namespace {

double in_us(Nanos time) { return static_cast<double>(time.count()) / 1000.0; }

}  // namespace

// Where something was wrong, what followed is kept for those who look for the reason.
void RunLedger::written(ByteView data, std::uint64_t offset) {
  ++writes_;
  write_begin_ = offset;
  from_driver_ += data.size();
  if (!first_data_) return;
  Bytes& came = first_data_->came;
  const ByteView more = data.first(std::min(data.size(), Mismatch::kMostCame - came.size()));
  came.insert(came.end(), more.begin(), more.end());
}

void RunLedger::told(const LineEvent& event) {
  if (const auto taped = event_of({Side::device, event})) ++told_[std::string(name_of(*taped))];
}

void RunLedger::place_in_write(Mismatch& mismatch) const {
  if (mismatch.offset < write_begin_) return;
  mismatch.write = writes_;
  mismatch.write_offset = mismatch.offset - write_begin_;
}

void RunLedger::mismatch(const Mismatch& mismatch) {
  ++mismatches_;
  std::optional<Mismatch>& first = mismatch.kind == MismatchKind::timing ? first_timing_ : first_data_;
  if (!first) first = mismatch;
}

void RunLedger::went_on(const std::string& where) {
  if (first_data_ && first_data_->went_on.empty()) first_data_->went_on = where;
}

Micros RunLedger::since_begin(Instant now) const { return std::chrono::floor<Micros>(now - begun_); }

// Data and extra outrank settings, these what is missing, and that timing: `timing-mismatch` means that all
// else was right.
RunReport RunLedger::report(const ReplayConfig& config, Instant now, Missing missing) const {
  const bool unsent = missing.unsent || missing.unplayed;
  RunReport report;
  report.writer = config.writer;
  report.strictness = config.strictness;
  report.timing = config.timing;
  report.rate = config.rate;
  if (config.chunks == Chunks::bytes) report.chunks = "bytes";
  if (config.chunks == Chunks::random) report.chunks = "random:" + std::to_string(config.chunk_seed);
  report.duration = now - begun_;
  report.idle = std::chrono::floor<Micros>(now - last_byte_);
  report.sessions_made = sessions_;
  report.to_driver_bytes = to_driver_;
  report.from_driver_bytes = from_driver_;
  report.told = told_;
  report.mismatches = mismatches_;
  report.timer_late_p50_us = in_us(lateness_.quantile(0.5));
  report.timer_late_p99_us = in_us(lateness_.quantile(0.99));
  report.timer_late_max_us = in_us(lateness_.max());
  report.mismatch = first_data_ ? first_data_ : first_timing_;
  report.settings = settings_;
  report.settings_checked = config.check_settings;
  report.must_read = config.must_read;
  const bool stopped = config.on_mismatch == OnMismatch::fail && first_timing_;
  if (config.strictness > 0 && first_data_) {
    report.verdict = first_data_->kind == MismatchKind::extra ? Verdict::extra : Verdict::data_mismatch;
  } else if (config.check_settings && !settings_.missing.empty() && !stopped) {
    report.verdict = Verdict::settings_mismatch;
  } else if (config.strictness == 0) {
    const bool silent = config.writer == Writer::device && from_driver_ == 0;
    report.verdict = missing.unplayed || (silent && unsent) ? Verdict::incomplete : Verdict::pass;
  } else if (unsent && !stopped) {
    report.verdict = Verdict::incomplete;
  } else if (first_timing_) {
    report.verdict = Verdict::timing_mismatch;
  }
  return report;
}

}  // namespace porttape
