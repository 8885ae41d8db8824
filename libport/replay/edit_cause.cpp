#include "libport/replay/edit_cause.hpp"

#include <algorithm>
#include <cctype>
#include <optional>
#include <utility>
#include <vector>

#include "libport/replay/byte_diff.hpp"
#include "libport/replay/checksum_guess.hpp"
#include "libport/replay/report_words.hpp"

namespace porttape {
namespace {

using Kind = Cause::Kind;

std::size_t body_length(ByteView frame) {
  std::size_t length = frame.size();
  while (length > 0 && is_line_end(frame[length - 1])) --length;
  return length;
}

// The stretch from the first to the last byte that is another.
struct Change {
  std::size_t at = 0;  // in the recorded frame
  Bytes recorded;
  Bytes came;
  std::size_t stretches = 0;
  bool case_only = true;
};

Byte lower(Byte byte) { return static_cast<Byte>(std::tolower(byte)); }

Change change_of(const std::vector<ByteEdit>& edits) {
  Change change;
  const auto differs = [](const ByteEdit& edit) { return !edit.same(); };
  const auto first = std::ranges::find_if(edits, differs);
  const auto last = std::find_if(edits.rbegin(), edits.rend(), differs).base();
  for (auto edit = edits.begin(); edit != first; ++edit) change.at += edit->recorded ? 1U : 0U;
  bool before = false;
  for (auto edit = first; edit < last; ++edit) {
    if (edit->recorded) change.recorded.push_back(*edit->recorded);
    if (edit->came) change.came.push_back(*edit->came);
    if (!edit->same() && !before) ++change.stretches;
    before = !edit->same();
    if (!edit->same())
      change.case_only =
          change.case_only && edit->recorded && edit->came && lower(*edit->recorded) == lower(*edit->came);
  }
  return change;
}

std::string at_byte(std::size_t at) { return " at byte " + std::to_string(at); }

std::string bytes_noun(std::size_t count) { return number_word(count) + (count == 1 ? " byte" : " bytes"); }

// The decimal number around the byte at `at`.
std::optional<std::uint64_t> number_around(ByteView frame, std::size_t at) {
  const auto is_digit = [frame](std::size_t i) { return i < frame.size() && std::isdigit(frame[i]) != 0; };
  if (!is_digit(at)) return std::nullopt;
  std::size_t begin = at;
  while (begin > 0 && is_digit(begin - 1)) --begin;
  std::uint64_t number = 0;
  for (std::size_t i = begin; is_digit(i); ++i) {
    if (i - begin >= 18) return std::nullopt;
    number = number * 10 + (frame[i] - '0');
  }
  return number;
}

// Whether a byte of the frame counts what follows it, or the frame.
bool is_length(ByteView frame, std::size_t at) {
  const std::size_t value = frame[at];
  const std::size_t behind = frame.size() - at - 1;
  return value > 1 &&
         (value == behind || value == frame.size() || value + 1 == behind || value + 2 == behind);
}

std::optional<Cause> number_cause(ByteView recorded, ByteView came, const Change& change,
                                  const std::string& what) {
  if (recorded.size() != came.size() || change.stretches != 1) return std::nullopt;
  const auto was = number_around(recorded, change.at);
  const auto is = number_around(came, change.at);
  if (was && is && (*was + 1 == *is || *is + 1 == *was)) {
    return Cause{Kind::off_by_one, false,
                 "looks like an off-by-one in " + what + ": " + std::to_string(*is) + " where the tape has " +
                     std::to_string(*was) + ',' + at_byte(change.at)};
  }
  if (change.recorded.size() != 1) return std::nullopt;
  const int step = static_cast<int>(change.came.front()) - static_cast<int>(change.recorded.front());
  if ((step != 1 && step != -1) || !is_length(recorded, change.at)) return std::nullopt;
  return Cause{Kind::off_by_one, false,
               "looks like an off-by-one length in " + what + ": " + to_hex(change.came) +
                   " where the tape has " + to_hex(change.recorded) + ',' + at_byte(change.at)};
}

std::optional<ChecksumGuess> checksum_of(const TapeExcerpt& excerpt) {
  std::vector<ByteView> frames;
  for (const TapeExcerpt::Step& step : excerpt.steps) frames.emplace_back(step.frame.bytes);
  return ChecksumGuess::of(frames);
}

Cause checksum_cause(const ChecksumGuess& guess, const ChecksumGuess::Field& has, const std::string& what) {
  return {Kind::checksum, true,
          "wrong checksum in " + what + ": " + named_bytes(has.has) + ", where the " +
              std::string(guess.name()) + " of its bytes is " + named_bytes(has.right)};
}

std::optional<Cause> line_end_cause(ByteView recorded, ByteView came, bool open_end,
                                    const std::string& what) {
  const std::size_t body = body_length(recorded);
  const std::size_t other = body_length(came);
  const bool same_body =
      body < recorded.size() && body == other && std::ranges::equal(recorded.first(body), came.first(other));
  if (!same_body) return std::nullopt;
  const ByteView end = recorded.subspan(body);
  if (other == came.size()) {
    if (open_end) return std::nullopt;
    return Cause{Kind::terminator, true,
                 "terminator missing: " + what + " came without its " + named_bytes(end)};
  }
  return Cause{Kind::terminator, true,
               "another terminator: " + what + " ends with " + named_bytes(came.subspan(other)) +
                   " where the tape has " + named_bytes(end)};
}

Cause bytes_cause(const Change& change, const std::string& what) {
  const std::string where = at_byte(change.at);
  if (change.recorded.empty()) {
    return {Kind::byte_more, true,
            bytes_noun(change.came.size()) + " more in " + what + ": " + named_bytes(change.came) + where};
  }
  if (change.came.empty()) {
    return {Kind::byte_less, true,
            bytes_noun(change.recorded.size()) + " less in " + what + ": the tape has " +
                named_bytes(change.recorded) + where};
  }
  const std::string instead =
      named_bytes(change.came) + " where the tape has " + named_bytes(change.recorded) + ',' + where;
  if (change.case_only)
    return {Kind::letter_case, true, "another case of letters in " + what + ": " + instead};
  if (change.recorded.size() == 1 && change.came.size() == 1)
    return {Kind::changed, true, "one byte of " + what + " is another: " + instead};
  const std::string which = change.stretches == 1 ? "other bytes in " : "several differences in ";
  return {Kind::changed, true, which + what + ": " + instead};
}

}  // namespace

Cause edit_cause(const TapeExcerpt& excerpt, std::size_t step, const CameFrame& came,
                 const std::string& what) {
  ByteView recorded = excerpt.steps[step].frame.bytes;
  ByteView other = came.bytes;
  if (auto cause = line_end_cause(recorded, other, came.open_end, what)) return *cause;
  if (const auto guess = checksum_of(excerpt)) {
    const auto field = guess->field(other);
    const auto tapes = guess->field(recorded);
    if (field && tapes) {
      const ByteView body = other.first(field->at);
      const bool same_body = std::ranges::equal(recorded.first(tapes->at), body);
      if (same_body && field->has != field->right) return checksum_cause(*guess, *field, what);
      // One that is right for other bytes is no difference of its own.
      if (!same_body && field->has == field->right) {
        recorded = recorded.first(tapes->at);
        other = body;
      }
    }
  }
  const std::vector<ByteEdit> edits = diff_bytes(recorded, other, came.open_end);
  if (differing(edits) == 0) return {Kind::changed, false, "other bytes in " + what};
  const Change change = change_of(edits);
  if (auto cause = number_cause(recorded, other, change, what)) return *cause;
  return bytes_cause(change, what);
}

}  // namespace porttape
