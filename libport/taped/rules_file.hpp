#pragma once

#include <string>

#include "libport/base/result.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// Reads a rules file (libport/rules/RULES.md). Errc::usage names the file, and for each of the first mistakes
// in it the line and the key.
Result<RuleSet> read_rules_file(const std::string& path);

}  // namespace porttape
