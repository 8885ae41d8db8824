#pragma once

#include <map>
#include <ostream>
#include <string>
#include <string_view>

#include "libport/base/result.hpp"
#include "tools/output.hpp"
#include "tools/test_format.hpp"

namespace porttape {

// What `porttape test --suite` is to do.
struct SuiteOptions {
  std::string folder;
  std::size_t jobs = 1;
  std::string only;                                // a pattern of names, or empty
  std::string junit_file;                          // or empty
  std::map<std::string, std::string> values = {};  // options that hold for each test, whatever the file says
  TestFormat format = TestFormat::text;
  ColorChoice color = ColorChoice::automatic;
};

// Runs the tests of a folder, each in a process and on a port of its own. The exit status: 0 where all
// passed, else the worst of theirs, 130, … when interrupted. Errc::usage: the suite cannot be read, or has no
// such test.
Result<int> run_suite(const SuiteOptions& options, std::ostream& out, std::ostream& err);

}  // namespace porttape
