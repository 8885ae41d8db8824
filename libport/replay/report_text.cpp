// The report for a person.

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/printable.hpp"
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

// "12.345 ms", without the zeros at its end.
std::string millis(Micros time) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.3f", static_cast<double>(time.count()) / 1000.0);
  std::string number = text.data();
  number.erase(number.find_last_not_of('0') + 1);
  if (number.back() == '.') number.pop_back();
  return number + " ms";
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

// Bytes as a person reads them in a sentence: in quotes where they are text, else in hex. `before` goes
// before them, of the same write.
std::string quoted(ByteView before, ByteView bytes) {
  const ByteView front = before.last(std::min(before.size(), kBytesAfter));
  const ByteView back = bytes.first(std::min(bytes.size(), kBytesAfter));
  Bytes all(front.begin(), front.end());
  all.insert(all.end(), back.begin(), back.end());
  const auto readable = std::ranges::count_if(all, [](Byte byte) {
    return (byte >= 0x20 && byte < 0x7F) || byte == '\n' || byte == '\r' || byte == '\t';
  });
  const bool is_text = static_cast<std::size_t>(readable) * 2 >= all.size();
  return (front.size() < before.size() ? ".." : "") +
         (is_text ? '"' + to_printable(all) + '"' : spaced_hex(all)) +
         (back.size() < bytes.size() ? ".." : "");
}

ByteView first_of(const Bytes& bytes, std::uint64_t count) {
  return ByteView(bytes).first(std::min<std::uint64_t>(bytes.size(), count));
}
ByteView last_of(const Bytes& bytes, std::uint64_t count) {
  return ByteView(bytes).last(std::min<std::uint64_t>(bytes.size(), count));
}

// What the driver wrote, as far as one write of the tape is to be compared with it: where that is a line, to
// the line's end.
ByteView got_of(const Mismatch& mismatch) {
  const ByteView got = mismatch.got;
  const ByteView expected = first_of(mismatch.expected, mismatch.block_after);
  if (expected.empty() || (expected.back() != '\n' && expected.back() != '\r')) return got;
  const auto end = std::ranges::find(got, expected.back());
  return end == got.end() ? got : ByteView(got.begin(), end + 1);
}

// What is wrong, in a sentence, and how it is called.
struct Cause {
  std::string_view kind;
  std::string text;
};

Cause cause_of(const Mismatch& mismatch) {
  const ByteView before = last_of(mismatch.before, mismatch.block_before);
  switch (mismatch.kind) {
    case MismatchKind::timing: {
      const bool late = mismatch.error.count() > 0;
      const std::string what = mismatch.got.empty() ? "a write" : quoted({}, mismatch.got);
      return {"timing mismatch", what + " came " + millis(late ? mismatch.error : -mismatch.error) +
                                     (late ? " later" : " earlier") + " than recorded (" +
                                     millis(mismatch.allowed) + " allowed)"};
    }
    case MismatchKind::extra:
      return {"extra", "the driver wrote " + quoted({}, mismatch.got) + " where the tape has nothing more"};
    case MismatchKind::data:
      break;
  }
  return {"data mismatch", "the driver wrote " + quoted(before, got_of(mismatch)) + " where the tape has " +
                               quoted(before, first_of(mismatch.expected, mismatch.block_after))};
}

// Where: on the driver's side of things, and on the tape.
std::string place(const Mismatch& mismatch) {
  std::string out = "  at ";
  if (mismatch.write > 0) {
    out += "byte " + std::to_string(mismatch.write_offset) + " of its write no. " +
           std::to_string(mismatch.write) + " (";
  }
  out += "byte " + std::to_string(mismatch.offset) + " of all it wrote" + (mismatch.write > 0 ? ", " : " (") +
         seconds_text(mismatch.real.count()) + " after its open; tape time " +
         seconds_text(to_us(mismatch.tape)) + ", exchange " + std::to_string(mismatch.exchange);
  if (mismatch.tape_offset != mismatch.offset)
    out += ", byte " + std::to_string(mismatch.tape_offset) + " of its writes";
  return out + ")\n";
}

// Behind the cause.
std::string mismatch_lines(const Mismatch& mismatch, const Paint& paint) {
  std::string out = place(mismatch);
  if (mismatch.kind == MismatchKind::timing)
    return out + "  our own delivery before it was " + millis(mismatch.own_late) + " late\n";
  out += comparison(mismatch, paint);
  if (!mismatch.hint.empty()) out += "  hint      " + mismatch.hint + '\n';
  return out;
}

// "no", "one", "two", …, in digits beyond ten.
std::string number_word(std::uint64_t number) {
  constexpr std::array<std::string_view, 11> words = {"no",  "one",   "two",   "three", "four", "five",
                                                      "six", "seven", "eight", "nine",  "ten"};
  return number < words.size() ? std::string(words.at(number)) : std::to_string(number);
}

// What the driver left out beside bytes: sessions, and its end of sending.
std::vector<std::string> left_out(const RunReport& report) {
  std::vector<std::string> out;
  if (report.sessions_made < report.sessions_of && !report.nobody_came) {
    out.push_back("the tape has " + number_word(report.sessions_of) + " session" +
                  (report.sessions_of == 1 ? "" : "s") + ", the driver made " +
                  number_word(report.sessions_made));
  }
  if (report.missed_half_close) {
    out.push_back("on the tape the driver ends its sending (half-close) at " +
                  seconds_text(to_us(*report.missed_half_close)) + "; here it did not");
  }
  return out;
}

// Whether all recorded bytes came, as far as that is known.
bool all_came(const RunReport& report) {
  return report.next_expected.empty() && report.from_driver_of &&
         report.from_driver_matched >= *report.from_driver_of;
}

Cause unsent_cause(const RunReport& report) {
  if (const std::vector<std::string> left = left_out(report); all_came(report) && !left.empty())
    return {"incomplete", left.front()};
  const ByteView write = first_of(report.next_expected, report.next_expected_block);
  const Bytes& before = report.next_expected_before;
  if (write.empty()) return {"incomplete", "recorded bytes never came from the driver"};
  if (before.empty()) return {"incomplete", "the driver never wrote " + quoted({}, write)};
  return {"incomplete", "the driver wrote " + quoted({}, before) + " of " + quoted(before, write)};
}

std::string unsent_lines(const RunReport& report) {
  std::string out;
  if (!report.next_expected.empty()) {
    out = "  the tape has it at " + seconds_text(to_us(report.next_expected_tape)) + ", byte " +
          std::to_string(report.next_expected_offset) + " of the driver's writes: " +
          spaced_hex(first_of(report.next_expected,
                              std::min<std::uint64_t>(kBytesAfter, report.next_expected_block))) +
          '\n';
  }
  if (!report.from_driver_of) return out;
  const std::uint64_t matched = std::min(report.from_driver_matched, *report.from_driver_of);
  return out + "  " + counted(*report.from_driver_of - matched, "recorded byte") +
         " never came from the driver\n";
}

// What passed.
std::string counts(const RunReport& report) {
  const std::optional<std::uint64_t>& from = report.from_driver_of;
  const std::optional<std::uint64_t>& to = report.to_driver_of;
  return (report.tape.empty() ? "" : printable_line(report.tape) + ": ") + "from the driver " +
         std::to_string(report.from_driver_matched) + (from ? " of " + counted(*from, "byte") : " bytes") +
         " as recorded, to the driver " + std::to_string(report.to_driver_bytes) +
         (to ? " of " + std::to_string(*to) : " (the tape was not counted)") + ", " +
         seconds_text(std::chrono::floor<Micros>(report.duration).count()) + '\n';
}

// Of a verdict that is none of pass.
Cause cause_of(const RunReport& report) {
  if (report.trouble) return {"failed", "the tape could not be read on: " + printable_line(*report.trouble)};
  if (report.verdict == Verdict::incomplete) return unsent_cause(report);
  return report.mismatch ? cause_of(*report.mismatch) : Cause{to_string(report.verdict), "see above"};
}

// The first line, and what there is to be known of it.
std::string finding(const RunReport& report, const Paint& paint) {
  const bool good = report.verdict == Verdict::pass && !report.trouble;
  const std::string doubts = report.doubts.empty() ? "" : ", with doubts";
  if (good && report.outcome.empty()) return paint.green("pass") + doubts + "  " + counts(report);
  std::string out;
  if (!report.outcome.empty()) out = paint.red(report.outcome) + doubts + '\n';
  if (!good) {
    const Cause cause = cause_of(report);
    const std::string kind(cause.kind);
    out += (report.outcome.empty() ? paint.red(kind) + doubts : "  verdict   " + kind) + ": " + cause.text +
           '\n';
  }
  const bool other_cause = good || report.trouble || report.verdict == Verdict::incomplete;
  if (report.verdict == Verdict::incomplete && !all_came(report)) out += unsent_lines(report);
  if (report.mismatch && other_cause) out += "  before    " + cause_of(*report.mismatch).text + '\n';
  if (report.mismatch) out += mismatch_lines(*report.mismatch, paint);
  return out + "  " + counts(report);
}

}  // namespace

std::string to_text(const RunReport& report, bool color) {
  const Paint paint(color);
  std::string out = finding(report, paint);
  const std::vector<std::string> left = left_out(report);
  const std::size_t said = report.verdict == Verdict::incomplete && all_came(report) ? 1 : 0;  // as the cause
  for (std::size_t n = said; n < left.size(); ++n) out += "  " + left[n] + '\n';
  for (const Doubt& doubt : report.doubts) {
    out += "  doubt     " + printable_line(doubt.text) + '\n';
  }
  if (report.mismatches > 1) out += "  mismatches in all: " + std::to_string(report.mismatches) + '\n';
  if (report.mismatch && report.mismatch->kind == MismatchKind::timing) {
    out += "  our own timers were late by " + micros(report.timer_late_p50_us) + " (median), " +
           micros(report.timer_late_p99_us) + " (99 %), " + micros(report.timer_late_max_us) + " (most)\n";
  }
  if (!report.command_end.empty()) out += "  the command " + report.command_end + '\n';
  return out;
}

std::string to_text(const Mismatch& mismatch, bool color) {
  const Paint paint(color);
  const Cause cause = cause_of(mismatch);
  return paint.red(cause.kind) + ": " + cause.text + '\n' + mismatch_lines(mismatch, paint);
}

}  // namespace porttape
