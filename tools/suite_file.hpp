#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/stranger_text.hpp"

namespace porttape {

// The tests of a folder (SUITE.md).
struct SuiteTest {
  StrangerText name;
  std::vector<std::string> command;
  std::map<std::string, std::string> values;  // options of the test by name, `tape` among them; checked
  StrangerText skip;                          // why it is not run, or empty
};
struct Suite {
  std::string folder;
  std::vector<SuiteTest> tests;
  std::vector<std::string> notes;  // what a user should know, a line each
};

inline constexpr std::string_view kSuiteFile = "suite.toml";

// Reads `folder`/suite.toml and looks for the folder's tapes. `for_all` are options that hold for
// each test, whatever the file says. Errc::usage names file, line and key.
Result<Suite> read_suite(const std::string& folder, const std::map<std::string, std::string>& for_all);

}  // namespace porttape
