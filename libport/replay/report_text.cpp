// The report for a person.

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

#include "libport/replay/report.hpp"
#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kBytesBefore = 8;
constexpr std::size_t kBytesAfter = 16;

class Paint {
 public:
  explicit Paint(bool on) : on_(on) {}
  [[nodiscard]] std::string red(std::string_view text) const { return wrap("\033[31m", text); }
  [[nodiscard]] std::string green(std::string_view text) const { return wrap("\033[32m", text); }
  [[nodiscard]] std::string bold(std::string_view text) const { return wrap("\033[1m", text); }

 private:
  [[nodiscard]] std::string wrap(std::string_view code, std::string_view text) const {
    if (!on_) return std::string(text);
    return std::string(code) + std::string(text) + "\033[0m";
  }
  bool on_;
};

// "12.345 ms"
std::string millis(Micros time) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.3f ms", static_cast<double>(time.count()) / 1000.0);
  return text.data();
}

std::string micros(double us) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.1f us", us);
  return text.data();
}

std::string counted(std::uint64_t count, std::string_view noun) {
  return std::to_string(count) + ' ' + std::string(noun) + (count == 1 ? "" : "s");
}

std::string spaced_hex(ByteView bytes) {
  std::string out;
  for (const Byte byte : bytes) {
    if (!out.empty()) out += ' ';
    out += to_hex(ByteView(&byte, 1));
  }
  return out;
}

// One side of the comparison: the bytes before, then its own, in hex and as text.
struct Side {
  std::string hex;
  std::string text;
};

Side side(ByteView before, ByteView bytes) {
  const bool cut = bytes.size() > kBytesAfter;
  const ByteView shown = bytes.first(std::min(bytes.size(), kBytesAfter));
  Side out{spaced_hex(before), '"' + to_printable(before)};
  if (!out.hex.empty() && !shown.empty()) out.hex += ' ';
  out.hex += spaced_hex(shown) + (cut ? " .." : "");
  out.text += to_printable(shown) + (cut ? "\".." : "\"");
  return out;
}

std::string padded(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}

std::string comparison(const Mismatch& mismatch, const Paint& paint) {
  const ByteView before = ByteView(mismatch.before).last(std::min(mismatch.before.size(), kBytesBefore));
  Side expected = side(before, mismatch.expected);
  const Side got = side(before, mismatch.got);
  const std::size_t width = std::max(expected.hex.size(), got.hex.size());
  if (mismatch.expected.empty()) expected.text += "  (the tape has no more)";
  const std::string indent(before.size() * 3, ' ');
  return "  expected  " + padded(expected.hex, width) + "  " + expected.text + '\n' +  //
         "  got       " + padded(got.hex, width) + "  " + got.text + '\n' +            //
         "            " + indent + paint.red("^^") + '\n';
}

// Where: on the driver's side of things, and on the tape.
std::string place(const Mismatch& mismatch) {
  return "byte " + std::to_string(mismatch.offset) + " from the driver, " +
         seconds_text(mismatch.real.count()) + " after its open\n  on the tape: exchange " +
         std::to_string(mismatch.exchange) + ", byte " + std::to_string(mismatch.tape_offset) +
         " of the writes, recorded at " + seconds_text(to_us(mismatch.tape)) + '\n';
}

std::string timing_lines(const Mismatch& mismatch, const Paint& paint) {
  const bool late = mismatch.error.count() > 0;
  const Micros size = late ? mismatch.error : -mismatch.error;
  return "  a write came " + paint.red(millis(size) + (late ? " late" : " early")) + ": " + place(mismatch) +
         "  our own delivery before it was " + millis(mismatch.own_late) + " late\n";
}

std::string mismatch_lines(const Mismatch& mismatch, const Paint& paint) {
  if (mismatch.kind == MismatchKind::timing) return timing_lines(mismatch, paint);
  const std::string_view what =
      mismatch.kind == MismatchKind::extra ? "more than the tape has" : "not what the tape has";
  std::string out = "  " + paint.bold(what) + ": " + place(mismatch) + comparison(mismatch, paint);
  if (!mismatch.hint.empty()) out += "  hint      " + mismatch.hint + '\n';
  return out;
}

std::string unsent_lines(const RunReport& report) {
  const Side next = side({}, report.next_expected);
  std::string out = "  recorded bytes";
  if (report.from_driver_of) {
    const std::uint64_t matched = std::min(report.from_driver_matched, *report.from_driver_of);
    out = "  " + counted(*report.from_driver_of - matched, "recorded byte");
  }
  out += " never came from the driver";
  if (report.next_expected.empty()) return out + '\n';
  return out + "; the first, byte " + std::to_string(report.next_expected_offset) +
         " of the tape's writes, recorded at " + seconds_text(to_us(report.next_expected_tape)) +
         ":\n  expected  " + next.hex + "  " + next.text + '\n';
}

// "no", "one", "two", …, in digits beyond ten.
std::string number_word(std::uint64_t number) {
  constexpr std::array<std::string_view, 11> words = {"no",  "one",   "two",   "three", "four", "five",
                                                      "six", "seven", "eight", "nine",  "ten"};
  return number < words.size() ? std::string(words.at(number)) : std::to_string(number);
}

// What the driver left out beside bytes: sessions, and its end of sending.
std::string left_out_lines(const RunReport& report) {
  std::string out;
  if (report.sessions_made < report.sessions_of && !report.nobody_came) {
    out += "  the tape has " + number_word(report.sessions_of) + " session" +
           (report.sessions_of == 1 ? "" : "s") + ", the driver made " + number_word(report.sessions_made) +
           '\n';
  }
  if (report.missed_half_close) {
    out += "  on the tape the driver ends its sending (half-close) at " +
           seconds_text(to_us(*report.missed_half_close)) + "; here it did not\n";
  }
  return out;
}

// Whether all recorded bytes came, as far as that is known.
bool all_came(const RunReport& report) {
  return report.next_expected.empty() && report.from_driver_of &&
         report.from_driver_matched >= *report.from_driver_of;
}

std::string head_line(const RunReport& report, const Paint& paint) {
  const std::string verdict(to_string(report.verdict));
  const std::optional<std::uint64_t>& from = report.from_driver_of;
  const std::optional<std::uint64_t>& to = report.to_driver_of;
  const bool good = report.verdict == Verdict::pass && !report.trouble;
  return (good ? paint.green(verdict) : paint.red(verdict)) + (report.doubts.empty() ? "" : ", with doubts") +
         (report.tape.empty() ? "" : "  " + to_printable(as_bytes(report.tape))) + ": from the driver " +
         std::to_string(report.from_driver_matched) + (from ? " of " + counted(*from, "byte") : " bytes") +
         " as recorded, to the driver " + std::to_string(report.to_driver_bytes) +
         (to ? " of " + std::to_string(*to) : " (the tape was not counted)") + ", " +
         seconds_text(std::chrono::floor<Micros>(report.duration).count()) + '\n';
}

}  // namespace

std::string to_text(const RunReport& report, bool color) {
  const Paint paint(color);
  std::string out = head_line(report, paint);
  if (report.trouble) out += "  " + paint.red("the tape could not be read on: ") + *report.trouble + '\n';
  if (report.mismatch) out += mismatch_lines(*report.mismatch, paint);
  for (const Doubt& doubt : report.doubts) {
    out += "  doubt     " + to_printable(as_bytes(doubt.text)) + '\n';
  }
  if (report.mismatches > 1) out += "  mismatches in all: " + std::to_string(report.mismatches) + '\n';
  if (report.verdict == Verdict::incomplete && !all_came(report)) out += unsent_lines(report);
  out += left_out_lines(report);
  if (report.mismatch && report.mismatch->kind == MismatchKind::timing) {
    out += "  our own timers were late by " + micros(report.timer_late_p50_us) + " (median), " +
           micros(report.timer_late_p99_us) + " (99 %), " + micros(report.timer_late_max_us) + " (most)\n";
  }
  if (report.command_exit && *report.command_exit != 0) {
    out += "  the command ended with status " + std::to_string(*report.command_exit) + '\n';
  }
  return out;
}

std::string to_text(const Mismatch& mismatch, bool color) {
  const Paint paint(color);
  const std::string_view kind = mismatch.kind == MismatchKind::timing  ? "timing mismatch"
                                : mismatch.kind == MismatchKind::extra ? "extra bytes"
                                                                       : "data mismatch";
  return paint.red(kind) + '\n' + mismatch_lines(mismatch, paint);
}

}  // namespace porttape
