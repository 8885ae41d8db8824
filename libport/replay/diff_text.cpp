#include "libport/replay/diff_text.hpp"

#include <algorithm>

#include "libport/replay/byte_diff.hpp"
#include "libport/replay/report_words.hpp"
#include "libport/replay/request_cause.hpp"

namespace porttape {
namespace {

constexpr std::size_t kBytesBefore = 8;
constexpr std::size_t kBytesAfter = 16;
constexpr std::size_t kMostRows = 10;

std::string padded(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}

// One side of a comparison, with a place for each byte of the other.
struct ComparedSide {
  std::string hex;
  Bytes shown;

  void add(const std::optional<Byte>& byte) {
    if (!hex.empty()) hex += ' ';
    hex += byte ? to_hex(ByteView(&*byte, 1)) : "--";
    if (byte) shown.push_back(*byte);
  }
  [[nodiscard]] std::string text(bool cut_before, bool cut_after) const {
    return (cut_before ? ".." : "") + ('"' + to_printable(shown)) + '"' + (cut_after ? ".." : "");
  }
};

std::string mark_of(const ByteEdit& edit) {
  if (edit.same()) return "  ";
  if (!edit.recorded) return "++";
  return edit.came ? "^^" : "--";
}

// `rest`: of what is recorded, behind what came. `behind`: what is said of the tape's bytes.
struct ComparedBytes {
  std::vector<ByteEdit> edits;
  ByteView rest;
  std::string behind;
};

std::string text_of(const ComparedBytes& comparison, const Paint& paint) {
  const std::vector<ByteEdit>& edits = comparison.edits;
  const auto first = std::ranges::find_if(edits, [](const ByteEdit& edit) { return !edit.same(); });
  const auto at = static_cast<std::size_t>(first - edits.begin());
  const std::size_t begin = at - std::min(at, kBytesBefore);
  const std::size_t end = std::min(edits.size(), at + kBytesAfter);
  ComparedSide expected;
  ComparedSide got;
  std::string marks;
  for (std::size_t i = begin; i < end; ++i) {
    expected.add(edits[i].recorded);
    got.add(edits[i].came);
    marks += mark_of(edits[i]) + ' ';
  }
  if (first == edits.end()) marks += "^^";
  const std::size_t room = end == edits.size() ? kBytesAfter - (end - std::min(at, end)) : 0;
  const ByteView rest = comparison.rest.first(std::min(room, comparison.rest.size()));
  for (const Byte byte : rest) expected.add(byte);
  const bool more = end < edits.size() || rest.size() < comparison.rest.size();
  const std::string cut = more ? " .." : "";
  const std::string got_cut = end < edits.size() ? " .." : "";
  const std::size_t width = std::max(expected.hex.size() + cut.size(), got.hex.size() + got_cut.size());
  marks.erase(marks.find_last_not_of(' ') + 1);
  return "  expected  " + padded(expected.hex + cut, width) + "  " + expected.text(begin > 0, more) +
         comparison.behind + '\n' +  //
         "  got       " + padded(got.hex + got_cut, width) + "  " + got.text(begin > 0, end < edits.size()) +
         '\n' +  //
         "            " + paint.red(marks) + '\n';
}

std::string changed_text(const TapeExcerpt& excerpt, const DiffRow& row, const Roles& roles,
                         const Paint& paint) {
  const ByteView recorded = excerpt.steps[*row.step].frame.bytes;
  ComparedBytes comparison{diff_bytes(recorded, row.came->bytes, row.came->open_end), {}, {}};
  std::size_t used = 0;
  for (const ByteEdit& edit : comparison.edits) used += edit.recorded ? 1U : 0U;
  if (row.came->open_end) comparison.rest = recorded.subspan(used);
  comparison.behind = "  " + frame_name(excerpt, *row.step, roles);
  return text_of(comparison, paint);
}

// A frame of one side alone, or of both.
std::string line_of(std::string label, ByteView bytes, const std::string& behind) {
  const ByteView shown = bytes.first(std::min(bytes.size(), kBytesAfter));
  const bool cut = shown.size() < bytes.size();
  return "  " + padded(std::move(label), 10) + spaced_hex(shown) + (cut ? " .." : "") + "  \"" +
         to_printable(shown) + '"' + (cut ? ".." : "") + behind + '\n';
}

// "  as request 3", where the tape has it.
std::string known_as(const TapeExcerpt& excerpt, const CameFrame& came, const Roles& roles) {
  std::optional<std::size_t> nearest;
  for (std::size_t step = 0; step < excerpt.steps.size(); ++step) {
    if (!excerpt.steps[step].frame.is(came.bytes)) continue;
    const auto distance = [&](std::size_t at) {
      return at < excerpt.place ? excerpt.place - at : at - excerpt.place;
    };
    if (!nearest || distance(step) < distance(*nearest)) nearest = step;
  }
  return nearest ? "  as " + frame_name(excerpt, *nearest, roles) : "";
}

std::string row_text(const TapeExcerpt& excerpt, const DiffRow& row, const Roles& roles, const Paint& paint) {
  switch (row.op) {
    case DiffRow::Op::changed:
      return changed_text(excerpt, row, roles, paint);
    case DiffRow::Op::added:
      return line_of("added", row.came->bytes, known_as(excerpt, *row.came, roles));
    case DiffRow::Op::same:
    case DiffRow::Op::left_out:
      break;
  }
  return line_of(row.op == DiffRow::Op::same ? "same" : "left out", excerpt.steps[*row.step].frame.bytes,
                 "  " + frame_name(excerpt, *row.step, roles));
}

}  // namespace

std::string diff_text(const TapeExcerpt& excerpt, const std::vector<DiffRow>& rows, const Roles& roles,
                      const Paint& paint) {
  std::string out;
  for (std::size_t i = 0; i < std::min(rows.size(), kMostRows); ++i)
    out += row_text(excerpt, rows[i], roles, paint);
  return out;
}

std::string diff_text(const Mismatch& mismatch, const Paint& paint) {
  const ByteView before = ByteView(mismatch.before).last(std::min(mismatch.before.size(), kBytesBefore));
  const ByteView got = ByteView(mismatch.got).first(std::min(mismatch.got.size(), kBytesAfter));
  ComparedBytes comparison;
  for (const Byte byte : before) comparison.edits.push_back({byte, byte});
  std::size_t used = 0;
  for (const ByteEdit& edit : diff_bytes(mismatch.expected, got, true)) {
    used += edit.recorded ? 1U : 0U;
    comparison.edits.push_back(edit);
  }
  comparison.rest = ByteView(mismatch.expected).subspan(used);
  if (mismatch.expected.empty()) comparison.behind = "  (the tape has no more)";
  return text_of(comparison, paint);
}

}  // namespace porttape
