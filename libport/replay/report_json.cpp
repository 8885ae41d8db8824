// The report of contract section 6.

#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/json_object.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/replay/context.hpp"
#include "libport/replay/faults_report.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/seconds_text.hpp"

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
  JsonObject json;
  json.add("kind", name_of(mismatch.kind))
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
      .add("rule", mismatch.why)
      .add("came_hex", to_hex(mismatch.came))
      .add("write", mismatch.write)
      .add("write_offset", mismatch.write_offset)
      .add("allowed_us", mismatch.allowed.count());
  if (!mismatch.went_on.empty()) json.add("went_on", mismatch.went_on);
  return json.str();
}

std::string next_expected_json(const RunReport& report) {
  return JsonObject()
      .add("offset", report.next_expected_offset)
      .add("tape_us", to_us(report.next_expected_tape))
      .add("hex", to_hex(report.next_expected))
      .str();
}

std::string_view name_of(Doubt::Kind kind) {
  switch (kind) {
    case Doubt::Kind::gap:
      return "gap";
    case Doubt::Kind::stall:
      return "stall";
    case Doubt::Kind::answer:
      return "answer";
    case Doubt::Kind::unchecked:
      return "unchecked";
    case Doubt::Kind::unread:
      return "unread";
    case Doubt::Kind::refused:
      return "refused";
    case Doubt::Kind::flushed:
      return "flushed";
  }
  return "";
}

std::string doubts_json(const std::vector<Doubt>& doubts) {
  std::string list;
  for (const Doubt& doubt : doubts) {
    if (!list.empty()) list += ',';
    list += JsonObject().add("kind", name_of(doubt.kind)).add("text", doubt.text).str();
  }
  return '[' + list + ']';
}

JsonObject settings_json(const RunReport& report) {
  JsonList missing;
  for (const auto& [at, what] : report.settings.missing) {
    JsonObject one;
    one.add("tape_us", to_us(at));
    add_line(one, what);
    missing.add(one);
  }
  return JsonObject()
      .add("recorded", report.settings.recorded)
      .add("made", report.settings.made)
      .add("missing", missing)
      .add_raw("checked", report.settings_checked ? "true" : "false");
}

JsonObject cause_json(const Cause& cause) {
  return JsonObject()
      .add("kind", to_string(cause.kind))
      .add_raw("certain", cause.certain ? "true" : "false")
      .add("text", cause.text)
      .add_or_null("exchange", cause.request);
}

std::string_view name_of(DiffRow::Op op) {
  switch (op) {
    case DiffRow::Op::same:
      return "same";
    case DiffRow::Op::changed:
      return "changed";
    case DiffRow::Op::left_out:
      return "left-out";
    case DiffRow::Op::added:
      break;
  }
  return "added";
}

JsonObject& add_frame(JsonObject& json, const TapeFrame& frame) {
  return json.add("exchange", frame.exchange)
      .add("part", frame.part)
      .add("parts", frame.parts)
      .add("tape_us", to_us(frame.at))
      .add("tape_offset", frame.offset)
      .add("tape_hex", to_hex(frame.bytes))
      .add("tape_bytes", frame.length);
}

JsonList diff_json(const RunReport& report) {
  JsonList list;
  for (const DiffRow& row : report.diagnosis.rows) {
    JsonObject one;
    one.add("op", name_of(row.op));
    if (row.step) add_frame(one, report.excerpt->steps[*row.step].frame);
    if (row.came) one.add("came_hex", to_hex(row.came->bytes));
    list.add(one);
  }
  return list;
}

constexpr std::size_t kMostAnswerShown = 256;

// An exchange beside the fault: what was asked, and what was answered.
std::string neighbour_json(const RunReport& report, const std::optional<std::size_t>& step) {
  if (!step) return "null";
  const TapeExcerpt::Step& at = report.excerpt->steps[*step];
  JsonObject json;
  add_frame(json, at.frame);
  if (!at.answer) return json.add_raw("answer", "null").str();
  const TapeAnswer& answer = *at.answer;
  const ByteView shown = ByteView(answer.bytes).first(std::min(answer.bytes.size(), kMostAnswerShown));
  return json
      .add("answer", JsonObject()
                         .add("hex", to_hex(shown))
                         .add("bytes", answer.length)
                         .add("delivered", delivered_of(report, answer))
                         .add("tape_us", to_us(answer.begun))
                         .add("until_us", to_us(answer.at)))
      .str();
}

std::string latency_json(const std::optional<ThinkTimes>& times) {
  if (!times) return "null";
  return JsonObject()
      .add("count", times->count)
      .add("median", times->median.count())
      .add("max", times->most.count())
      .add("max_exchange", times->most_at)
      .add("recorded_median", times->recorded_median.count())
      .add("recorded_max", times->recorded_most.count())
      .str();
}

// Why, and what surrounds it.
void add_diagnosis(JsonObject& json, const RunReport& report) {
  const std::optional<Cause>& cause = report.diagnosis.cause;
  if (is_incomplete_by_unread(report)) {
    json.add("cause", "unread");  // a verdict's own
  } else {
    json.add_raw("cause", cause ? cause_json(*cause).str() : "null");
  }
  json.add("diff", diff_json(report));
  const Neighbours around =
      report.excerpt && exit_status_of(report) != 0 ? neighbours_of(report) : Neighbours{};
  json.add_raw("previous", neighbour_json(report, around.previous))
      .add_raw("next", neighbour_json(report, around.next))
      .add_raw("latency_us", latency_json(report.think_times))
      .add_or_null("left_unread", report.left_unread)
      .add_or_null("unread", report.unread)
      .add("idle_us", report.idle.count())
      .add_raw("closed", report.closed ? "true" : "false")
      .add("outcome", report.outcome)
      .add("command_end", report.command_end);
  const bool shown = !report.repeat_line.empty();
  json.add_raw(
      "commands",
      shown ? JsonObject().add("repeat", report.repeat_line).add("step", report.step_line).str() : "null");
}

// Both directions, by their keys: what came from who is judged, and what went to it.
void add_directions(JsonObject& json, const RunReport& report, const JsonObject& came,
                    const JsonObject& went) {
  const bool driver = report.writer == Writer::driver;
  json.add("to_driver", driver ? went : came).add("from_driver", driver ? came : went);
}

JsonObject lookup_json(const LookupReport& report) {
  JsonList never;
  for (const LookupReport::Request& request : report.never_asked) {
    never.add(JsonObject()
                  .add("tape_us", to_us(request.at))
                  .add("offset", request.offset)
                  .add("size", request.size)
                  .add("hex", to_hex(request.bytes)));
  }
  return JsonObject()
      .add("requests", report.requests)
      .add("asked", report.asked)
      .add("answered", report.answered)
      .add("unknown", report.unknown)
      .add("undelivered", report.undelivered)
      .add("never_asked", never);
}

double seconds_of(Nanos time) { return static_cast<double>(std::chrono::floor<Micros>(time).count()) / 1e6; }

JsonObject playback_json(const PlaybackReport& played) {
  const auto max_gap = played.max_gap ? std::optional(seconds_of(Nanos(*played.max_gap))) : std::nullopt;
  JsonObject json;
  json.add("start_s", seconds_of(played.start))
      .add_or_null("end_s", played.end ? std::optional(seconds_of(*played.end)) : std::nullopt)
      .add_raw("preroll", played.preroll ? "true" : "false")
      .add_or_null("max_gap_s", max_gap)
      .add("loops", played.loops)
      .add("loops_complete", played.loops_complete)
      .add_or_null("loops_of", played.loops_of)
      .add("pauses", played.pauses)
      .add("paused_s", seconds_of(played.paused))
      .add("steps", played.steps)
      .add("seeks", played.seeks)
      .add("rates", played.rates);
  return json;
}

}  // namespace

std::string run_json(const RunReport& report) {
  const std::optional<Mismatch>& mismatch = report.mismatch;
  const bool driver = report.writer == Writer::driver;
  JsonObject json;
  json.add("verdict", to_string(report.verdict))
      .add("exit", exit_status_of(report))
      .add("when", report.when)
      .add("duration_s", seconds_of(report.duration))
      .add_raw("mismatch",
               mismatch
                   ? JsonObject().add("kind", name_of(mismatch->kind)).add("offset", mismatch->offset).str()
                   : "null")
      .add("bytes", JsonObject()
                        .add("to_driver", driver ? report.to_driver_bytes : report.from_driver_bytes)
                        .add("from_driver", driver ? report.from_driver_bytes : report.to_driver_bytes))
      .add_raw("doubts", doubts_json(report.doubts));
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
      .add("duration_s", seconds_of(report.duration));
  add_directions(json, report,
                 JsonObject()
                     .add("bytes", report.from_driver_bytes)
                     .add("matched", report.from_driver_matched)
                     .add_or_null("of", report.from_driver_of),
                 JsonObject().add("bytes", report.to_driver_bytes).add_or_null("of", report.to_driver_of));
  json.add_raw("mismatch", report.mismatch ? mismatch_json(*report.mismatch) : "null")
      .add("timer_late_us", JsonObject()
                                .add("p50", report.timer_late_p50_us)
                                .add("p99", report.timer_late_p99_us)
                                .add("max", report.timer_late_max_us))
      .add_or_null("command_exit", report.command_exit)
      .add("mismatches", report.mismatches)
      .add_raw("doubts", doubts_json(report.doubts))
      .add_raw("next_expected", report.next_expected.empty() ? "null" : next_expected_json(report));
  JsonObject told;
  for (const auto& [kind, count] : report.told) told.add(kind, count);
  json.add("sessions", JsonObject().add("made", report.sessions_made).add("of", report.sessions_of))
      .add_or_null("session", report.session)
      .add_or_null("missed_half_close_us",
                   report.missed_half_close ? std::optional(to_us(*report.missed_half_close)) : std::nullopt)
      .add("settings", settings_json(report))
      .add("told", told)
      .add("playback", playback_json(report.playback));
  json.add("writer", roles_of(report.writer).name);
  if (report.lookup) json.add("lookup", lookup_json(*report.lookup));
  if (!report.chunks.empty()) json.add("chunks", report.chunks);
  add_diagnosis(json, report);
  json.add_raw("faults", report.faults ? to_json(*report.faults) : "null");
  if (report.trouble) json.add("trouble", *report.trouble);
  if (report.connection) json.add("connection", *report.connection);
  if (!runs.empty()) json.add_raw("runs", runs);
  return json.str() + '\n';
}

}  // namespace porttape
