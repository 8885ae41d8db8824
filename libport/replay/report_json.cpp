// The report of contract section 6.

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/json_object.hpp"
#include "libport/replay/report.hpp"

namespace porttape {
namespace {

std::string_view name_of(MismatchKind kind) {
  switch (kind) {
    case MismatchKind::data:
      return "data";
    case MismatchKind::timing:
      return "timing";
    case MismatchKind::extra:
      break;
  }
  return "extra";
}

std::string_view name_of(Timing timing) {
  switch (timing) {
    case Timing::reactive:
      return "reactive";
    case Timing::recorded:
      return "recorded";
    case Timing::none:
      break;
  }
  return "none";
}

std::string mismatch_json(const Mismatch& mismatch) {
  return JsonObject()
      .add("kind", name_of(mismatch.kind))
      .add("offset", mismatch.offset)
      .add("tape_us", to_us(mismatch.tape))
      .add("real_us", mismatch.real.count())
      .add("expected_hex", to_hex(mismatch.expected))
      .add("got_hex", to_hex(mismatch.got))
      .add("error_us", mismatch.error.count())
      .add("hint", mismatch.hint)
      .add("before_hex", to_hex(mismatch.before))
      .add("exchange", mismatch.exchange)
      .add("tape_offset", mismatch.tape_offset)
      .add("own_late_us", mismatch.own_late.count())
      .str();
}

std::string next_expected_json(const RunReport& report) {
  return JsonObject()
      .add("offset", report.next_expected_offset)
      .add("tape_us", to_us(report.next_expected_tape))
      .add("hex", to_hex(report.next_expected))
      .str();
}

std::string doubts_json(const std::vector<Doubt>& doubts) {
  std::string list;
  for (const Doubt& doubt : doubts) {
    if (!list.empty()) list += ',';
    list += JsonObject()
                .add("kind", doubt.kind == Doubt::Kind::gap ? "gap" : "stall")
                .add("text", doubt.text)
                .str();
  }
  return '[' + list + ']';
}

double seconds(Nanos time) { return static_cast<double>(std::chrono::floor<Micros>(time).count()) / 1e6; }

}  // namespace

std::string run_json(const RunReport& report) {
  const std::optional<Mismatch>& mismatch = report.mismatch;
  JsonObject json;
  json.add("verdict", to_string(report.verdict))
      .add("exit", exit_status_of(report))
      .add("when", report.when)
      .add("duration_s", seconds(report.duration))
      .add_raw("mismatch",
               mismatch
                   ? JsonObject().add("kind", name_of(mismatch->kind)).add("offset", mismatch->offset).str()
                   : "null")
      .add(
          "bytes",
          JsonObject().add("to_driver", report.to_driver_bytes).add("from_driver", report.from_driver_bytes));
  if (report.connection) json.add("connection", *report.connection);
  return json.str();
}

std::string to_json(const RunReport& report, std::string_view runs) {
  JsonObject json;
  json.add("verdict", to_string(report.verdict))
      .add("exit", exit_status_of(report))
      .add("tape", report.tape)
      .add("strictness", report.strictness)
      .add("timing", name_of(report.timing))
      .add("rate", report.rate)
      .add("duration_s", seconds(report.duration))
      .add("to_driver",
           JsonObject().add("bytes", report.to_driver_bytes).add_or_null("of", report.to_driver_of))
      .add("from_driver", JsonObject()
                              .add("bytes", report.from_driver_bytes)
                              .add("matched", report.from_driver_matched)
                              .add_or_null("of", report.from_driver_of))
      .add_raw("mismatch", report.mismatch ? mismatch_json(*report.mismatch) : "null")
      .add("timer_late_us", JsonObject()
                                .add("p50", report.timer_late_p50_us)
                                .add("p99", report.timer_late_p99_us)
                                .add("max", report.timer_late_max_us))
      .add_or_null("command_exit", report.command_exit)
      .add("mismatches", report.mismatches)
      .add_raw("doubts", doubts_json(report.doubts))
      .add_raw("next_expected", report.next_expected.empty() ? "null" : next_expected_json(report));
  json.add("sessions", JsonObject().add("made", report.sessions_made).add("of", report.sessions_of))
      .add_or_null("session", report.session)
      .add_or_null("missed_half_close_us",
                   report.missed_half_close ? std::optional(to_us(*report.missed_half_close)) : std::nullopt);
  if (report.trouble) json.add("trouble", *report.trouble);
  if (report.connection) json.add("connection", *report.connection);
  if (!runs.empty()) json.add_raw("runs", runs);
  return json.str() + '\n';
}

}  // namespace porttape
