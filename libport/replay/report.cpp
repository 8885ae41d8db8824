#include "libport/replay/report.hpp"

#include "libport/base/error.hpp"

namespace porttape {

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass:
      return "pass";
    case Verdict::data_mismatch:
      return "data-mismatch";
    case Verdict::settings_mismatch:
      return "settings-mismatch";
    case Verdict::timing_mismatch:
      return "timing-mismatch";
    case Verdict::incomplete:
      return "incomplete";
    case Verdict::extra:
      break;
  }
  return "extra";
}

void add_totals(RunReport& report, const TapeTotals& totals) {
  const PlaybackReport& played = report.playback;
  const std::uint64_t loops = played.loops_of.value_or(played.loops);
  report.to_driver_of = played.prerolled.reads + (totals.reads - totals.reads_before) * loops;
  report.from_driver_of = played.prerolled.writes + (totals.writes - totals.writes_before) * loops;
  if (report.undecided_from && totals.writes > *report.undecided_from) report.verdict = Verdict::incomplete;
  report.undecided_from.reset();
}

void give_up_totals(RunReport& report, std::string_view why) {
  if (!report.undecided_from) return;
  report.undecided_from.reset();
  report.verdict = Verdict::incomplete;
  if (!report.trouble) report.trouble = why;
}

void damage(RunReport& report, std::string_view why) {
  if (report.verdict == Verdict::pass) report.verdict = Verdict::incomplete;
  report.undecided_from.reset();
  report.trouble = why;
}

int exit_status_of(const RunReport& report) {
  if (report.process_exit) return *report.process_exit;
  if (report.trouble) return exit_status::kRuntime;
  switch (report.verdict) {
    case Verdict::pass:
      return report.command_exit.value_or(0) == 0 ? exit_status::kPass : exit_status::kRuntime;
    case Verdict::timing_mismatch:
      return exit_status::kTimingMismatch;
    case Verdict::incomplete:
      return exit_status::kIncomplete;
    case Verdict::data_mismatch:
    case Verdict::settings_mismatch:
    case Verdict::extra:
      break;
  }
  return exit_status::kDataMismatch;
}

}  // namespace porttape
