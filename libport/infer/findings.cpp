#include "libport/infer/findings.hpp"

#include <algorithm>
#include <map>
#include <numeric>

#include "libport/infer/checksum_search.hpp"
#include "libport/infer/echo.hpp"
#include "libport/infer/frame_kinds.hpp"
#include "libport/infer/kind_fields.hpp"
#include "libport/rules/checksum.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostFrames = 2000;  // of a session

std::vector<std::vector<Frame>> all_frames(std::span<const SessionTape> sessions,
                                           std::span<const FrameSort> sorts, Findings& findings) {
  std::vector<std::vector<Frame>> all;
  for (const SessionTape& session : sessions) {
    std::vector<Frame>& frames = all.emplace_back(cut_frames(session, sorts));
    std::size_t framed = 0;
    for (const Frame& frame : frames) framed += frame.bytes.size();
    findings.other_bytes += session.writes.size() - framed;
    findings.left_out += frames.size() - std::min(frames.size(), kMostFrames);
    frames.resize(std::min(frames.size(), kMostFrames));
    findings.frames += frames.size();
  }
  return all;
}

// The frames of one sort, tape by tape.
std::vector<FrameRun> runs_of(const SessionFrames& frames, std::size_t sort) {
  std::vector<FrameRun> runs;
  for (const auto& session : frames) {
    FrameRun& run = runs.emplace_back();
    for (const Frame& frame : session)
      if (frame.sort == sort) run.push_back(frame.bytes);
  }
  return runs;
}

void find_checksums(Findings& findings, const SessionFrames& frames) {
  for (std::size_t sort = 0; sort < findings.sorts.size(); ++sort) {
    FrameFormat& format = findings.sorts[sort].sort.format;
    if (format.checksum) continue;
    std::vector<ByteView> all;
    for (const FrameRun& run : runs_of(frames, sort)) all.insert(all.end(), run.begin(), run.end());
    format.checksum = find_checksum_field(all);
  }
}

}  // namespace

std::size_t FoundKind::frames() const {
  return std::accumulate(runs.begin(), runs.end(), std::size_t{0},
                         [](std::size_t sum, const FrameRun& run) { return sum + run.size(); });
}

ByteView FoundSort::body(ByteView frame) const {
  const FrameFormat& format = sort.format;
  if (format.checksum) {
    const ChecksumKind* kind = find_checksum(format.checksum->kind);
    const auto place = FrameChecksum(*format.checksum, *kind).place(frame);
    if (place) return frame.first(place->begin);
  }
  const std::size_t end = sort.text ? format.end.size() + format.trailer : 0;
  return frame.first(frame.size() - std::min(frame.size(), end));
}

Findings find_differences(std::span<const SessionTape> sessions) {
  Findings findings;
  FoundSorts found = find_sorts(sessions);
  findings.why = std::move(found.why);
  for (const FrameSort& sort : found.sorts) findings.sorts.push_back({sort, {}});
  const auto frames = all_frames(sessions, found.sorts, findings);
  find_checksums(findings, frames);
  for (std::size_t sort = 0; sort < findings.sorts.size(); ++sort)
    find_sort_counters(findings.sorts[sort], runs_of(frames, sort));
  const std::vector<Column> columns = find_columns(findings, frames);
  for (std::size_t sort = 0; sort < findings.sorts.size(); ++sort)
    keep_differing_counters(findings.sorts[sort], columns_of(columns, frames, sort));
  for (KindColumns& kind : find_kinds(findings, frames, columns)) {
    find_fields(findings.sorts[kind.kind.sort], kind);
    findings.kinds.push_back(std::move(kind.kind));
  }
  find_answers(findings, sessions);
  return findings;
}

}  // namespace porttape
