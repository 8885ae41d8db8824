#pragma once

#include <map>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port_type.hpp"
#include "tools/output.hpp"
#include "tools/test_format.hpp"
#include "tools/test_verdict.hpp"

namespace porttape {

// How the verdict of one test is told on stdout (--format, --color).
struct VerdictView {
  ColorChoice color = ColorChoice::automatic;
  TestFormat format = TestFormat::text;
};

// The options for it.
std::vector<OptionSpec> view_options();
// Takes them out of what was given. Errc::usage.
Result<VerdictView> take_view(std::map<std::string, std::string>& values);

// On `out`, flushed. As text a test that could not begin is the caller's to tell.
void tell(const TestVerdict& verdict, const VerdictView& view, std::ostream& out);

// Where the JSON report and the JUnit file go; empty: not wanted. `verb`, such as "porttape test", is the
// JUnit suite, and begins what is told on stderr.
struct ReportFiles {
  std::string_view verb;
  std::string report = {};
  std::string junit = {};
};

// Writes the files, whatever came of the test, and then tells the verdict, so that none is told as good whose
// report could not be written: that is the outcome then, there and in the other file. Returns the status to
// end with, or the verdict's error.
Result<int> end_test(TestVerdict verdict, const VerdictView& view, const ReportFiles& files,
                     std::ostream& out, std::ostream& err);

}  // namespace porttape
