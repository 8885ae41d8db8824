#include "libport/replay/report.hpp"

#include <algorithm>
#include <fmt/format.h>

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

namespace {

// What was recorded as read and reached no program, as far as that is certain, and what could have.
struct Unread {
  std::uint64_t bytes = 0;
  std::uint64_t of = 0;
  bool all_known = true;  // false: more may have been due
};

// Of endless loops those count that were played to their end: the last may end anywhere, but for the first.
std::uint64_t due_of(const RunReport& report) {
  const PlaybackReport& played = report.playback;
  const std::uint64_t all = report.to_driver_of.value_or(0);
  if (played.loops_of || played.loops == 0) return all;
  const std::uint64_t whole = played.loops == 1 ? played.loops_complete : played.loops - 1;
  return played.prerolled.reads + (all - std::min(all, played.prerolled.reads)) / played.loops * whole;
}

// What was delivered and not read, as far as that is known.
std::uint64_t left_in_all(const RunReport& report) {
  return report.left_unread.value_or(0) + report.left_unread_before;
}

// Where a user steered it by hand, how much was due is not known.
Unread unread_of(const RunReport& report) {
  const std::uint64_t left = left_in_all(report);
  if (report.lookup) {
    const std::uint64_t waits = report.lookup->undelivered;
    return {left + waits, report.to_driver_bytes + waits};
  }
  const bool again = report.playback.loops_of != 1;
  if (report.playback.steered() || !report.to_driver_of || report.leaves_out || (report.rewritten && again))
    return {left, report.to_driver_of.value_or(0), false};
  // What is rewritten may be longer than on the tape, or shorter.
  const std::uint64_t came =
      report.rewritten ? report.delivered : report.to_driver_bytes + report.reads_excused;
  const std::uint64_t due = due_of(report);
  return {left + due - std::min(due, came), due};
}

// Whether the tape has reads alone, and the driver took none of them. Then it is certain that they were not
// read, whatever decides how many were due.
bool ignored_all(const RunReport& report) {
  return report.from_driver_of == 0U && report.to_driver_of.value_or(0) > report.reads_excused &&
         report.to_driver_bytes <= left_in_all(report);
}

// The share in percent; of a small one that there is any.
std::string share_text(std::uint64_t part, std::uint64_t all) {
  const double percent = 100.0 * static_cast<double>(part) / static_cast<double>(all);
  return percent < 0.1 ? "less than 0.1 %" : fmt::format("{:.1f} %", percent);
}

}  // namespace

void judge_reading(RunReport& report) {
  const bool judged =
      report.verdict == Verdict::pass && report.writer == Writer::driver && !report.nobody_came;
  if (!judged) return;
  const bool ignored = ignored_all(report);
  const auto [unread, all, all_known] =
      ignored ? Unread{*report.to_driver_of - report.reads_excused, *report.to_driver_of} : unread_of(report);
  if (unread == 0) {
    const bool only_speaks = report.from_driver_of == 0U && report.to_driver_bytes > 0;
    const bool untold = report.left_unseen || (report.left_untold && (report.must_read || only_speaks));
    const bool nothing_came = report.to_driver_bytes == 0 && all > report.reads_excused;
    if (untold)
      report.doubts.push_back({Doubt::Kind::unread,
                               "what the driver left unread when it closed is not known: the kernel did not "
                               "tell it"});
    else if (report.left_flushed && (report.must_read || only_speaks))
      report.doubts.push_back(
          {Doubt::Kind::unread,
           "the driver dropped what had come to it (tcflush) where the tape's did not: whether it "
           "had read all of that is not known"});
    else if (!all_known && nothing_came)
      report.doubts.push_back(
          {Doubt::Kind::unread,
           fmt::format("nothing of the {} bytes that were recorded as read came to the driver; rules, or who "
                       "steered the run, decide how much of it should have",
                       all)});
    else if (report.must_read && !all_known)
      report.doubts.push_back({Doubt::Kind::unread,
                               "whether the driver read all that it should have is not known: rules, or who "
                               "steered the run, decide how much that is"});
    return;
  }
  report.unread = unread;
  if (all >= unread) report.unread_of = all;
  if (report.strictness > 0 && (report.must_read || ignored)) {
    report.verdict = Verdict::incomplete;
    return;
  }
  const std::string of_all = all >= unread ? fmt::format(" of {} ({})", all, share_text(unread, all)) : "";
  const char* const one = unread == 1 ? "was" : "were";
  const char* const remedy = report.strictness > 0 ? "; --must-read makes that the verdict"
                             : report.must_read    ? "; at strictness 0 that is no verdict"
                                                   : "";
  report.doubts.push_back(
      {Doubt::Kind::unread, fmt::format("{} byte{}{} that {} recorded as read {} not read{}", unread,
                                        unread == 1 ? "" : "s", of_all, one, one, remedy)});
}

bool is_incomplete_by_unread(const RunReport& report) {
  return report.verdict == Verdict::incomplete && report.unread && !report.trouble;
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
