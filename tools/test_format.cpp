#include "tools/test_format.hpp"

#include <fmt/format.h>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

// Behind "ok 1 - ": # and \ mean something there.
std::string description(std::string_view text) {
  std::string out;
  for (const char c : printable_line(text)) {
    if (c == '#' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

}  // namespace

OptionSpec format_option() {
  return {"format",
          OptionSpec::Kind::choice,
          "text",
          "how the verdict comes on stdout: text, one JSON object, or TAP; the command's own output goes to "
          "stderr with the last two",
          0,
          0,
          {"text", "json", "tap"}};
}

Result<TestFormat> read_format(std::string_view value) {
  const Result<std::string> choice = check_value(format_option(), value);
  if (!choice) return choice.error();
  if (*choice == "json") return TestFormat::json;
  return *choice == "tap" ? TestFormat::tap : TestFormat::text;
}

std::string tap_head(std::size_t tests) { return fmt::format("TAP version 13\n1..{}\n", tests); }

std::string tap_of(const TestCase& test, std::size_t number) {
  const bool good = test.outcome == TestCase::Outcome::passed || test.outcome == TestCase::Outcome::skipped;
  const bool skipped = test.outcome == TestCase::Outcome::skipped;
  std::string out =
      fmt::format("{} {} - {}{}\n", good ? "ok" : "not ok", number, description(test.name.raw()),
                  skipped ? " # SKIP " + test.message.for_line() : "");
  if (good) {
    for (const StrangerText& doubt : test.doubts) out += "# doubt: " + doubt.for_line() + '\n';
    return out;
  }
  out += fmt::format("  ---\n  message: {}\n  kind: {}\n  exit: {}\n  duration_ms: {:.3f}\n",
                     test.message.for_json(), json_quote(test.kind), test.exit_status, test.seconds * 1e3);
  // In quotes: Perl's reader takes neither blocks with an indentation nor lists of texts with colons.
  if (!test.text.empty()) out += "  report: " + test.text.for_json() + '\n';
  if (!test.output.empty()) out += "  output: " + test.output.for_json() + '\n';
  return out + "  ...\n";
}

std::string tap_bail_out(std::string_view why) { return fmt::format("Bail out!  {}\n", printable_line(why)); }

std::string_view to_string(TestCase::Outcome outcome) {
  switch (outcome) {
    case TestCase::Outcome::passed:
      return "pass";
    case TestCase::Outcome::failed:
      return "fail";
    case TestCase::Outcome::error:
      return "error";
    case TestCase::Outcome::skipped:
      break;
  }
  return "skip";
}

JsonObject json_of(const TestCase& test, std::string_view report) {
  JsonList doubts;
  for (const StrangerText& doubt : test.doubts) doubts.add_raw(doubt.for_json());
  JsonObject json;
  json.add("test", test.name)
      .add("outcome", to_string(test.outcome))
      .add("exit", test.exit_status)
      .add("duration_s", test.seconds)
      .add("kind", test.kind)
      .add("message", test.message)
      .add("text", test.text)
      .add("output", test.output)
      .add("doubts", doubts)
      .add_raw("report", report.empty() ? "null" : report);
  return json;
}

}  // namespace porttape
