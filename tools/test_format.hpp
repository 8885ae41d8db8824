#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "libport/base/json_object.hpp"
#include "libport/base/result.hpp"
#include "libport/port/port_type.hpp"
#include "libport/replay/test_case.hpp"

namespace porttape {

// How verdicts come on stdout (--format): for a person, as JSON, or in the Test Anything Protocol, version
// 13, which a reader of version 14 takes too.
enum class TestFormat { text, json, tap };

OptionSpec format_option();
Result<TestFormat> read_format(std::string_view value);  // Errc::usage

// "TAP version 13", and how many tests follow.
std::string tap_head(std::size_t tests);
// The lines of one test; `number` counts from 1.
std::string tap_of(const TestCase& test, std::size_t number);
// What ends the stream where not all tests were run.
std::string tap_bail_out(std::string_view why);

std::string_view to_string(TestCase::Outcome outcome);
// A test of a suite as JSON (OUTPUT.md, "porttape test --suite"); `report` is the run's, or "null".
JsonObject json_of(const TestCase& test, std::string_view report);

}  // namespace porttape
