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

// Writes the JSON report and the JUnit file, where they are wanted, whatever came of the test; `verb`, such
// as "porttape test", is the JUnit suite.
Result<void> write_reports(const TestVerdict& verdict, std::string_view verb, const std::string& report,
                           const std::string& junit);

}  // namespace porttape
