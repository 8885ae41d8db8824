#include "libport/replay/context.hpp"

#include <algorithm>

#include "libport/replay/report_words.hpp"
#include "libport/replay/request_cause.hpp"

namespace porttape {
namespace {

std::string asked(const RunReport& report, std::size_t step) {
  return frame_name(*report.excerpt, step, roles_of(report.writer)) + ' ' +
         bytes_text(report.excerpt->steps[step].frame.bytes);
}

std::string after(Micros time) { return " after " + millis_text(time); }

std::string text_of(const RunReport& report, std::size_t step, bool came) {
  const TapeExcerpt::Step& at = report.excerpt->steps[step];
  std::string out = asked(report, step);
  if (!at.answer || report.writer == Writer::device) return out;
  const TapeAnswer& answer = *at.answer;
  out += ", on the tape answered by " + bytes_text(answer.bytes) + " (" + counted(answer.length, "byte") +
         after(answer.begun - at.frame.at) + ')';
  if (!came) return out;
  const std::uint64_t there = delivered_of(report, answer);
  return out + (there == answer.length ? ", all of which came here"
                                       : ", of which " + counted(there, "byte") + " came here");
}

}  // namespace

Neighbours neighbours_of(const RunReport& report) {
  const TapeExcerpt& excerpt = *report.excerpt;
  Neighbours out;
  if (excerpt.place > 0) out.previous = excerpt.place - 1;
  std::size_t shown = excerpt.place;
  for (const DiffRow& row : report.diagnosis.rows) {
    if (row.step) shown = std::max(shown, *row.step);
  }
  if (shown + 1 < excerpt.steps.size()) out.next = shown + 1;
  return out;
}

std::uint64_t delivered_of(const RunReport& report, const TapeAnswer& answer) {
  const bool data = report.mismatch && report.verdict != Verdict::incomplete;
  const std::uint64_t delivered = data ? report.mismatch->delivered : report.delivered;
  return std::min(answer.length, delivered - std::min(delivered, answer.offset));
}

Context context_of(const RunReport& report) {
  const Neighbours around = neighbours_of(report);
  Context out;
  if (around.previous) out.previous = text_of(report, *around.previous, true);
  if (around.next) out.next = text_of(report, *around.next, false);
  return out;
}

}  // namespace porttape
