// The report of contract section 6. Written by hand: the keys keep their order and numbers their form,
// whatever the locale.

#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/json_text.hpp"
#include "libport/replay/report.hpp"

namespace porttape {
namespace {

// The shortest text that gives the same number; 0 for what JSON has no number for.
std::string number(double value) {
  if (!std::isfinite(value)) return "0";
  std::array<char, 40> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  return {text.data(), end};
}

std::string number(std::uint64_t value) { return std::to_string(value); }
std::string number(std::int64_t value) { return std::to_string(value); }
std::string number(int value) { return std::to_string(value); }
std::string number(const std::optional<std::uint64_t>& value) { return value ? number(*value) : "null"; }

// Collects `"key":value` pairs.
class Object {
 public:
  Object& add(std::string_view key, const std::string& json) {
    text_ += text_.empty() ? "{" : ",";
    text_ += json_quote(key) + ':' + json;
    return *this;
  }
  [[nodiscard]] std::string str() const { return text_.empty() ? "{}" : text_ + '}'; }

 private:
  std::string text_;
};

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
  return Object()
      .add("kind", json_quote(name_of(mismatch.kind)))
      .add("offset", number(mismatch.offset))
      .add("tape_us", number(to_us(mismatch.tape)))
      .add("real_us", number(std::int64_t{mismatch.real.count()}))
      .add("expected_hex", json_quote(to_hex(mismatch.expected)))
      .add("got_hex", json_quote(to_hex(mismatch.got)))
      .add("error_us", number(std::int64_t{mismatch.error.count()}))
      .add("hint", json_quote(mismatch.hint))
      .add("before_hex", json_quote(to_hex(mismatch.before)))
      .add("exchange", number(mismatch.exchange))
      .add("tape_offset", number(mismatch.tape_offset))
      .add("own_late_us", number(std::int64_t{mismatch.own_late.count()}))
      .str();
}

std::string next_expected_json(const RunReport& report) {
  return Object()
      .add("offset", number(report.next_expected_offset))
      .add("tape_us", number(to_us(report.next_expected_tape)))
      .add("hex", json_quote(to_hex(report.next_expected)))
      .str();
}

std::string doubts_json(const std::vector<Doubt>& doubts) {
  std::string list;
  for (const Doubt& doubt : doubts) {
    if (!list.empty()) list += ',';
    list += Object()
                .add("kind", json_quote(doubt.kind == Doubt::Kind::gap ? "gap" : "stall"))
                .add("text", json_quote(doubt.text))
                .str();
  }
  return '[' + list + ']';
}

double seconds(Nanos time) { return static_cast<double>(std::chrono::floor<Micros>(time).count()) / 1e6; }

}  // namespace

std::string to_json(const RunReport& report) {
  Object json;
  json.add("verdict", json_quote(to_string(report.verdict)))
      .add("exit", number(exit_status_of(report)))
      .add("tape", json_quote(report.tape))
      .add("strictness", number(report.strictness))
      .add("timing", json_quote(name_of(report.timing)))
      .add("rate", number(report.rate))
      .add("duration_s", number(seconds(report.duration)))
      .add("to_driver",
           Object().add("bytes", number(report.to_driver_bytes)).add("of", number(report.to_driver_of)).str())
      .add("from_driver", Object()
                              .add("bytes", number(report.from_driver_bytes))
                              .add("matched", number(report.from_driver_matched))
                              .add("of", number(report.from_driver_of))
                              .str())
      .add("mismatch", report.mismatch ? mismatch_json(*report.mismatch) : "null")
      .add("timer_late_us", Object()
                                .add("p50", number(report.timer_late_p50_us))
                                .add("p99", number(report.timer_late_p99_us))
                                .add("max", number(report.timer_late_max_us))
                                .str())
      .add("command_exit", report.command_exit ? number(*report.command_exit) : "null")
      .add("mismatches", number(report.mismatches))
      .add("doubts", doubts_json(report.doubts))
      .add("next_expected", report.next_expected.empty() ? "null" : next_expected_json(report));
  if (report.trouble) json.add("trouble", json_quote(*report.trouble));
  return json.str() + '\n';
}

}  // namespace porttape
