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
#include "libport/line/line_settings_text.hpp"
#include "libport/replay/context.hpp"
#include "libport/replay/diff_text.hpp"
#include "libport/replay/faults_report.hpp"
#include "libport/replay/paint.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/report_words.hpp"
#include "libport/replay/roles.hpp"
#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostBytes = 16;

std::string micros(double us) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.1f us", us);
  return text.data();
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

std::string text_of(std::string_view text) { return std::string(text); }

// What is wrong, in a sentence, and how it is called.
struct Headline {
  std::string_view kind;
  std::string text;
};

Headline headline_of(const Mismatch& mismatch, const Roles& roles) {
  const ByteView before = last_of(mismatch.before, mismatch.block_before);
  switch (mismatch.kind) {
    case MismatchKind::timing: {
      const bool late = mismatch.error.count() > 0;
      const std::string what = mismatch.got.empty() ? "a write" : bytes_text({}, mismatch.got);
      return {"timing mismatch", what + " came " + millis_text(late ? mismatch.error : -mismatch.error) +
                                     (late ? " later" : " earlier") + " than recorded (" +
                                     millis_text(mismatch.allowed) + " allowed)"};
    }
    case MismatchKind::extra:
      return {"extra", wrote_text(roles, bytes_text({}, mismatch.got)) + " where the tape has nothing more"};
    case MismatchKind::data:
      break;
  }
  return {"data mismatch", wrote_text(roles, bytes_text(before, got_of(mismatch))) + " where the tape has " +
                               bytes_text(before, first_of(mismatch.expected, mismatch.block_after))};
}

// Where: on the side of who wrote it, and on the tape.
std::string place(const Mismatch& mismatch, const Roles& roles) {
  std::string out = "  at ";
  if (mismatch.write > 0) {
    out += "byte " + std::to_string(mismatch.write_offset) + " of its " + text_of(roles.write) + " no. " +
           std::to_string(mismatch.write) + " (";
  }
  out += "byte " + std::to_string(mismatch.offset) + " of all it " + text_of(roles.wrote) +
         (mismatch.write > 0 ? ", " : " (") + seconds_text(mismatch.real.count()) + " after " +
         text_of(roles.open) + "; tape time " + seconds_text(to_us(mismatch.tape)) + ", exchange " +
         std::to_string(mismatch.exchange);
  if (mismatch.tape_offset != mismatch.offset)
    out += ", byte " + std::to_string(mismatch.tape_offset) + " of its " + text_of(roles.writes);
  return out + ")\n";
}

// Behind the headline. `diff`: the bytes of both sides.
std::string mismatch_lines(const Mismatch& mismatch, const Roles& roles, const std::string& diff) {
  std::string out = place(mismatch, roles);
  if (mismatch.kind == MismatchKind::timing)
    return out + "  our own delivery before it was " + millis_text(mismatch.own_late) + " late\n";
  out += diff;
  if (!mismatch.why.empty()) out += "  rule      " + mismatch.why + '\n';
  if (!mismatch.went_on.empty()) out += "  resync    " + mismatch.went_on + '\n';
  if (!mismatch.hint.empty()) out += "  hint      " + mismatch.hint + '\n';
  return out;
}

// The exchange before the one with the fault, and the next after what is shown.
std::string context_lines(const RunReport& report) {
  if (!report.excerpt) return {};
  const Context context = context_of(report);
  std::string out;
  if (context.previous) out += "  previous  " + *context.previous + '\n';
  if (context.next) out += "  next      " + *context.next + '\n';
  return out;
}

// How long the driver took, where that may have to do with what is wrong.
std::string think_line(const RunReport& report) {
  if (!report.think_times || report.writer != Writer::driver) return {};
  const ThinkTimes& times = *report.think_times;
  return "  latency   from an answer to the next request the driver took " + millis_text(times.median) +
         " (median) and " + millis_text(times.most) + " (most, before request " +
         std::to_string(times.most_at) + "); on the tape " + millis_text(times.recorded_median) + " and " +
         millis_text(times.recorded_most) + '\n';
}

// What to type next.
std::string command_lines(const RunReport& report) {
  std::string out;
  if (!report.repeat_line.empty()) out += "  repeat    " + printable_line(report.repeat_line) + '\n';
  if (!report.step_line.empty()) out += "  step      " + printable_line(report.step_line) + '\n';
  return out;
}

std::string diff_of(const RunReport& report, const Paint& paint) {
  const std::vector<DiffRow>& rows = report.diagnosis.rows;
  if (rows.empty()) return diff_text(*report.mismatch, paint);
  return diff_text(*report.excerpt, rows, roles_of(report.writer), paint);
}

constexpr std::size_t kSettingsTold = 8;

std::string text_of(const SettingsReport::Missing& missing) {
  return to_text(missing.what) + ", as the tape has it at " + seconds_text(to_us(missing.at));
}

bool is_signal(const SettingsReport::Missing& missing) { return missing.what.settings == SeenSettings(); }

// In short where it made none of many.
std::string settings_cause(const SettingsReport& settings) {
  const SettingsReport::Missing& first = settings.missing.front();
  const std::string never =
      (is_signal(first) ? " never switched " : " never made its line ") + text_of(first);
  if (settings.made > 0 || settings.recorded == 1) return "the driver" + never;
  const bool any_signal = std::ranges::any_of(settings.missing, is_signal);
  return "the driver made none of the " + std::to_string(settings.recorded) + " settings" +
         (any_signal ? " and signals" : "") + " on the tape; it" + never;
}

// Lines for what the first line does not say of the settings.
std::string settings_lines(const RunReport& report) {
  const SettingsReport& settings = report.settings;
  if (report.settings_checked && settings.recorded == 0)
    return "  settings  none to check: the tape has none of a driver in what was played\n";
  std::string out;
  const bool said = report.verdict == Verdict::settings_mismatch && !report.trouble;
  const std::size_t told = settings.made == 0 ? 1 : std::min(settings.missing.size(), kSettingsTold);
  for (std::size_t i = said ? 1 : 0; i < std::min(told, settings.missing.size()); ++i) {
    out +=
        "  settings  " + (i == 0 ? settings_cause(settings) : "nor " + text_of(settings.missing[i])) + '\n';
  }
  const std::uint64_t missing = settings.recorded - settings.made;
  if (settings.made > 0 && missing > told)
    out += "  settings  and " + std::to_string(missing - told) + " more\n";
  return out;
}

std::string told_line(const RunReport& report) {
  std::string out;
  for (const auto& [kind, count] : report.told)
    out += (out.empty() ? "  events    of the device: " : ", ") + std::to_string(count) + ' ' + kind;
  return out.empty() ? out : out + '\n';
}

// What the driver left out beside bytes: sessions, and its end of sending.
std::vector<std::string> left_out(const RunReport& report) {
  std::vector<std::string> out;
  // Of a device's run the tape makes them, as far as it goes.
  const bool makes_them = report.writer == Writer::driver;
  if (makes_them && report.sessions_made < report.sessions_of && !report.nobody_came) {
    out.push_back("the tape has " + number_word(report.sessions_of) + " session" +
                  (report.sessions_of == 1 ? "" : "s") + ", " + text_of(roles_of(report.writer).one) +
                  " made " + number_word(report.sessions_made));
  }
  if (report.missed_half_close) {
    out.push_back("on the tape " + text_of(roles_of(report.writer).one) +
                  " ends its sending (half-close) at " + seconds_text(to_us(*report.missed_half_close)) +
                  "; here it did not");
  }
  return out;
}

// Whether all recorded bytes came, as far as that is known.
bool all_came(const RunReport& report) {
  return report.next_expected.empty() && report.from_driver_of &&
         report.from_driver_matched >= *report.from_driver_of;
}

Headline unsent_headline(const RunReport& report) {
  if (is_incomplete_by_unread(report)) {
    const std::string all = report.unread_of ? " of " + std::to_string(*report.unread_of) : "";
    return {"incomplete", text_of(roles_of(report.writer).one) + " did not read " +
                              std::to_string(*report.unread) + all + " bytes that were recorded as read"};
  }
  if (const std::vector<std::string> left = left_out(report); all_came(report) && !left.empty())
    return {"incomplete", left.front()};
  const bool never_opened = report.nobody_came && report.writer == Writer::driver;
  if (all_came(report)) {
    return {"incomplete",
            never_opened ? "the driver never opened its port" : "the tape was not played to its end"};
  }
  const ByteView write = first_of(report.next_expected, report.next_expected_block);
  const Bytes& before = report.next_expected_before;
  const Roles roles = roles_of(report.writer);
  const std::string one(roles.one);
  if (write.empty()) return {"incomplete", "recorded bytes never came from " + one};
  if (before.empty())
    return {"incomplete", one + " never " + text_of(roles.wrote) + ' ' + bytes_text({}, write)};
  return {"incomplete", wrote_text(roles, bytes_text({}, before)) + " of " + bytes_text(before, write)};
}

std::string unsent_lines(const RunReport& report) {
  const Roles roles = roles_of(report.writer);
  std::string out;
  if (!report.next_expected.empty()) {
    out = "  the tape has it at " + seconds_text(to_us(report.next_expected_tape)) + ", byte " +
          std::to_string(report.next_expected_offset) + " of " + text_of(roles.one) + "'s " +
          text_of(roles.writes) + ": " +
          spaced_hex(first_of(report.next_expected,
                              std::min<std::uint64_t>(kMostBytes, report.next_expected_block))) +
          '\n';
  }
  if (!report.from_driver_of) return out;
  const std::uint64_t matched = std::min(report.from_driver_matched, *report.from_driver_of);
  return out + "  " + counted(*report.from_driver_of - matched, "recorded byte") + " never came from " +
         text_of(roles.one) + '\n';
}

constexpr std::size_t kRequestsTold = 8;

// Of match=lookup: what passed, and what was never asked for.
std::string lookup_counts(const RunReport& report) {
  const LookupReport& lookup = *report.lookup;
  return (report.tape.empty() ? "" : printable_line(report.tape) + ": ") +
         counted(lookup.answered, "request") + " answered, " + std::to_string(lookup.asked) +
         " of the tape's " + counted(lookup.requests, "different one") + ", to the driver " +
         counted(report.to_driver_bytes, "byte") + ", " +
         seconds_text(std::chrono::floor<Micros>(report.duration).count()) + '\n';
}

std::string never_asked_lines(const LookupReport& lookup) {
  std::string out;
  const std::size_t told = std::min(lookup.never_asked.size(), kRequestsTold);
  for (std::size_t i = 0; i < told; ++i) {
    const LookupReport::Request& request = lookup.never_asked[i];
    const ByteView shown = first_of(request.bytes, kMostBytes);
    out += "  not asked " + bytes_text({}, shown) + (shown.size() < request.size ? ".." : "") +
           ", as the tape has it at " + seconds_text(to_us(request.at)) + '\n';
  }
  const std::uint64_t never = lookup.requests - lookup.asked;
  return never > told ? out + "  not asked " + std::to_string(never - told) + " more\n" : out;
}

// Rules may let more or less come than is recorded, and it counts as that.
std::string came_by_rules(const RunReport& report) {
  if (!report.ruled || report.verdict != Verdict::pass || report.mismatches > 0) return "";
  if (report.from_driver_bytes == report.from_driver_matched) return "";
  return " (by the rules; " + std::to_string(report.from_driver_bytes) + " came)";
}

// What passed.
std::string counts(const RunReport& report) {
  if (report.lookup) return lookup_counts(report);
  const std::optional<std::uint64_t>& from = report.from_driver_of;
  const std::optional<std::uint64_t>& to = report.to_driver_of;
  const std::string one(roles_of(report.writer).one);
  return (report.tape.empty() ? "" : printable_line(report.tape) + ": ") + "from " + one + ' ' +
         std::to_string(report.from_driver_matched) + (from ? " of " + counted(*from, "byte") : " bytes") +
         " as recorded" + came_by_rules(report) + ", to " + one + ' ' +
         std::to_string(report.to_driver_bytes) +
         (to ? " of " + std::to_string(*to) : " (the tape was not counted)") + ", " +
         seconds_text(std::chrono::floor<Micros>(report.duration).count()) + '\n';
}

// Of a verdict that is none of pass.
Headline headline_of(const RunReport& report) {
  if (report.trouble) return {"failed", "the tape could not be read on: " + printable_line(*report.trouble)};
  if (report.verdict == Verdict::incomplete) return unsent_headline(report);
  if (report.verdict == Verdict::settings_mismatch)
    return {"settings mismatch", settings_cause(report.settings)};
  if (report.mismatch) return headline_of(*report.mismatch, roles_of(report.writer));
  return {to_string(report.verdict), "see above"};
}

// The first line, and what there is to be known of it.
std::string finding(const RunReport& report, const Paint& paint) {
  const bool good = report.verdict == Verdict::pass && !report.trouble;
  const std::string doubts = report.doubts.empty() ? "" : ", with doubts";
  if (good && report.outcome.empty()) return paint.green("pass") + doubts + "  " + counts(report);
  std::string out;
  if (!report.outcome.empty()) out = paint.red(report.outcome) + doubts + '\n';
  if (!good) {
    const Headline headline = headline_of(report);
    const std::string kind(headline.kind);
    out += (report.outcome.empty() ? paint.red(kind) + doubts : "  verdict   " + kind) + ": " +
           headline.text + '\n';
  }
  if (const auto& cause = report.diagnosis.cause) out += "  cause     " + paint.bold(cause->text) + '\n';
  const bool other_cause = good || report.trouble || report.verdict == Verdict::incomplete ||
                           report.verdict == Verdict::settings_mismatch;
  const bool by_what_came = report.verdict == Verdict::incomplete && !is_incomplete_by_unread(report);
  if (by_what_came && !all_came(report)) out += unsent_lines(report);
  if (report.mismatch && other_cause)
    out += "  before    " + headline_of(*report.mismatch, roles_of(report.writer)).text + '\n';
  if (report.mismatch)
    out += mismatch_lines(*report.mismatch, roles_of(report.writer), diff_of(report, paint));
  if (!good) out += context_lines(report);
  return out + "  " + counts(report);
}

}  // namespace

std::string to_text(const RunReport& report, bool color) {
  const Paint paint(color);
  std::string out = finding(report, paint);
  const std::vector<std::string> left = left_out(report);
  const bool by_what_came = report.verdict == Verdict::incomplete && !is_incomplete_by_unread(report);
  const std::size_t said = by_what_came && all_came(report) ? 1 : 0;  // as the cause
  for (std::size_t n = said; n < left.size(); ++n) out += "  " + left[n] + '\n';
  out += settings_lines(report) + told_line(report);
  if (report.lookup) out += never_asked_lines(*report.lookup);
  if (report.chunks.starts_with("random"))
    out += "  chunks    cut by chance; --chunks " + report.chunks + " cuts so again\n";
  if (report.faults) out += "  faults    " + to_text(*report.faults) + '\n';
  out += to_text(report.playback);
  for (const Doubt& doubt : report.doubts) {
    out += "  doubt     " + printable_line(doubt.text) + '\n';
  }
  if (report.mismatches > 1) out += "  mismatches in all: " + std::to_string(report.mismatches) + '\n';
  if (report.mismatch && report.mismatch->kind == MismatchKind::timing) {
    out += "  our own timers were late by " + micros(report.timer_late_p50_us) + " (median), " +
           micros(report.timer_late_p99_us) + " (99 %), " + micros(report.timer_late_max_us) + " (most)\n";
  }
  if (!report.command_end.empty()) out += "  the command " + report.command_end + '\n';
  const bool good = exit_status_of(report) == 0;
  const bool told = report.diagnosis.cause && report.diagnosis.cause->kind == Cause::Kind::unread;
  if (report.left_unread.value_or(0) > 0 && !told && !report.unread && report.timing != Timing::recorded) {
    out += "  unread    " + counted(*report.left_unread, "byte") + " of what was answered, when " +
           text_of(roles_of(report.writer).one) + " closed\n";
  }
  return good ? out : out + think_line(report) + command_lines(report);
}

std::string to_text(const Mismatch& mismatch, Writer writer, bool color) {
  const Paint paint(color);
  const Roles roles = roles_of(writer);
  const Headline headline = headline_of(mismatch, roles);
  return paint.red(headline.kind) + ": " + headline.text + '\n' +
         mismatch_lines(mismatch, roles, diff_text(mismatch, paint));
}

}  // namespace porttape
