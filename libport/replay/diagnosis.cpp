#include "libport/replay/diagnosis.hpp"

#include <algorithm>

#include "libport/replay/report.hpp"

namespace porttape {

std::optional<std::uint64_t> place_of_fault(const RunReport& report) {
  if (report.trouble || report.verdict == Verdict::settings_mismatch) return std::nullopt;
  if (report.mismatch && report.verdict != Verdict::incomplete) return report.mismatch->tape_offset;
  if (!report.next_expected.empty()) return report.next_expected_offset;
  return std::nullopt;
}

Bytes came_from_frame(const RunReport& report, const TapeExcerpt& excerpt) {
  const Mismatch& mismatch = *report.mismatch;
  Bytes came;
  if (excerpt.place < excerpt.steps.size()) {
    const TapeFrame& frame = excerpt.steps[excerpt.place].frame;
    const std::uint64_t in_frame = mismatch.tape_offset - std::min(mismatch.tape_offset, frame.offset);
    const auto head = static_cast<std::size_t>(std::min<std::uint64_t>(in_frame, frame.bytes.size()));
    const ByteView before = head <= mismatch.before.size() ? ByteView(mismatch.before).last(head)
                                                           : ByteView(frame.bytes).first(head);
    came.assign(before.begin(), before.end());
  }
  const Bytes& rest = mismatch.came.empty() ? mismatch.got : mismatch.came;
  came.insert(came.end(), rest.begin(), rest.end());
  return came;
}

std::optional<Bytes> answer_elsewhere(const TapeExcerpt& excerpt, ByteView came) {
  const std::vector<CameFrame> frames = cut_came(excerpt, came);
  if (frames.size() != 1) return std::nullopt;
  const auto is_answered = [&](const TapeExcerpt::Step& step) {
    return step.frame.is(frames.front().bytes) && step.answer &&
           step.answer->bytes.size() == step.answer->length;
  };
  const auto place = excerpt.steps.begin() + static_cast<std::ptrdiff_t>(excerpt.place);
  const auto later = std::find_if(place, excerpt.steps.end(), is_answered);
  if (later != excerpt.steps.end()) return later->answer->bytes;
  const auto before = std::find_if(std::make_reverse_iterator(place), excerpt.steps.rend(), is_answered);
  return before == excerpt.steps.rend() ? std::nullopt : std::optional(before->answer->bytes);
}

void diagnose(RunReport& report) {
  report.diagnosis = {};
  const bool data = report.verdict == Verdict::data_mismatch || report.verdict == Verdict::extra;
  if (report.excerpt && data && report.mismatch) {
    const std::vector<CameFrame> came = cut_came(*report.excerpt, came_from_frame(report, *report.excerpt));
    report.diagnosis.rows = align_frames(*report.excerpt, came);
  }
  report.diagnosis.cause = find_cause(report);
}

}  // namespace porttape
