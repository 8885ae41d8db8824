// The report of contract section 6. Written by hand: the keys keep their order and numbers their form,
// whatever the locale.

#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>

#include "libport/replay/report.hpp"

namespace porttape {
namespace {

// The length of the well-formed UTF-8 sequence `text` starts with; 0 when there is none.
std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned lead = byte(0);
  const std::size_t length = lead < 0x80                   ? 1
                             : lead >= 0xC2 && lead < 0xE0 ? 2
                             : lead >= 0xE0 && lead < 0xF0 ? 3
                             : lead >= 0xF0 && lead < 0xF5 ? 4
                                                           : 0;
  if (length == 0 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) return 0;
  }
  // Overlong forms, surrogates, and what lies beyond U+10FFFF.
  if (lead == 0xE0 && byte(1) < 0xA0) return 0;
  if (lead == 0xED && byte(1) > 0x9F) return 0;
  if (lead == 0xF0 && byte(1) < 0x90) return 0;
  if (lead == 0xF4 && byte(1) > 0x8F) return 0;
  return length;
}

void append_escaped(std::string& out, char character) {
  switch (character) {
    case '"':
      out += "\\\"";
      return;
    case '\\':
      out += "\\\\";
      return;
    case '\n':
      out += "\\n";
      return;
    case '\r':
      out += "\\r";
      return;
    case '\t':
      out += "\\t";
      return;
    default:
      break;
  }
  const auto code = static_cast<unsigned char>(character);
  if (code >= 0x20 && code != 0x7F) {
    out += character;
    return;
  }
  out += "\\u00";
  out += to_hex(ByteView(&code, 1));
}

std::string quoted(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    if (length == 0) {
      out += "\\ufffd";
    } else if (length == 1) {
      append_escaped(out, text[0]);
    } else {
      out += text.substr(0, length);
    }
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return out + '"';
}

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

// Collects `"key":value` pairs.
class Object {
 public:
  Object& add(std::string_view key, const std::string& json) {
    text_ += text_.empty() ? "{" : ",";
    text_ += quoted(key) + ':' + json;
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
      .add("kind", quoted(name_of(mismatch.kind)))
      .add("offset", number(mismatch.offset))
      .add("tape_us", number(to_us(mismatch.tape)))
      .add("real_us", number(std::int64_t{mismatch.real.count()}))
      .add("expected_hex", quoted(to_hex(mismatch.expected)))
      .add("got_hex", quoted(to_hex(mismatch.got)))
      .add("error_us", number(std::int64_t{mismatch.error.count()}))
      .add("hint", quoted(mismatch.hint))
      .add("before_hex", quoted(to_hex(mismatch.before)))
      .add("exchange", number(mismatch.exchange))
      .add("tape_offset", number(mismatch.tape_offset))
      .add("own_late_us", number(std::int64_t{mismatch.own_late.count()}))
      .str();
}

std::string next_expected_json(const RunReport& report) {
  return Object()
      .add("offset", number(report.next_expected_offset))
      .add("tape_us", number(to_us(report.next_expected_tape)))
      .add("hex", quoted(to_hex(report.next_expected)))
      .str();
}

double seconds(Nanos time) { return static_cast<double>(std::chrono::floor<Micros>(time).count()) / 1e6; }

}  // namespace

std::string to_json(const RunReport& report) {
  Object json;
  json.add("verdict", quoted(to_string(report.verdict)))
      .add("exit", number(exit_status_of(report)))
      .add("tape", quoted(report.tape))
      .add("strictness", number(report.strictness))
      .add("timing", quoted(name_of(report.timing)))
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
      .add("next_expected", report.next_expected.empty() ? "null" : next_expected_json(report));
  if (report.trouble) json.add("trouble", quoted(*report.trouble));
  return json.str() + '\n';
}

}  // namespace porttape
