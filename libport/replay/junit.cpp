// JUnit's XML as Jenkins and GitLab read it (jenkins-junit.xsd): XML 1.0, UTF-8, no control characters.

#include <array>
#include <cmath>
#include <concepts>
#include <cstdio>
#include <string>
#include <string_view>

#include "libport/base/xml_text.hpp"
#include "libport/replay/test_case.hpp"

namespace porttape {
namespace {

std::string attribute(std::string_view name, std::string_view value) {
  return ' ' + std::string(name) + "=\"" + xml_text(value, false) + '"';
}

template <std::same_as<StrangerText> Text>
std::string attribute(std::string_view name, const Text& value) {
  return ' ' + std::string(name) + "=\"" + value.for_attribute() + '"';
}

std::string number(std::string_view name, std::size_t value) {
  return attribute(name, std::to_string(value));
}

std::string seconds_of(double seconds) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.6f", std::isfinite(seconds) && seconds > 0 ? seconds : 0.0);
  return attribute("time", text.data());
}

std::string trouble(std::string_view element, const TestCase& test) {
  return "      <" + std::string(element) + attribute("message", test.message) +
         attribute("type", test.kind) + '>' + test.text.for_element() + "</" + std::string(element) + ">\n";
}

std::string body_of(const TestCase& test) {
  std::string out;
  if (test.outcome == TestCase::Outcome::failed) out = trouble("failure", test);
  if (test.outcome == TestCase::Outcome::error) out = trouble("error", test);
  if (test.outcome == TestCase::Outcome::skipped)
    out = "      <skipped" + attribute("message", test.message) + "/>\n";
  // The text of a failure, which has its doubts, stands there already.
  const bool doubtful = test.outcome == TestCase::Outcome::passed && !test.doubts.empty();
  const std::string said = (doubtful ? test.text.for_element() : "") + test.output.for_element();
  if (!said.empty()) out += "      <system-out>" + said + "</system-out>\n";
  return out;
}

std::string case_of(const TestCase& test) {
  const std::string head = "    <testcase" + attribute("name", test.name) +
                           attribute("classname", test.group) + seconds_of(test.seconds);
  const std::string body = body_of(test);
  return body.empty() ? head + "/>\n" : head + ">\n" + body + "    </testcase>\n";
}

}  // namespace

std::string to_junit(std::string_view suite, std::span<const TestCase> tests, double seconds) {
  TestCounts counts;
  for (const TestCase& test : tests) counts.add(test);
  const std::string sums =
      number("tests", counts.all()) + number("failures", counts.failed) + number("errors", counts.errors);
  std::string out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites" +
                    attribute("name", "porttape") + sums + seconds_of(seconds) + ">\n  <testsuite" +
                    attribute("name", suite) + sums + number("skipped", counts.skipped) +
                    seconds_of(seconds) + ">\n";
  for (const TestCase& test : tests) out += case_of(test);
  return out + "  </testsuite>\n</testsuites>\n";
}

}  // namespace porttape
