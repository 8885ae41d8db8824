#pragma once

#include <string>
#include <string_view>

#include "libport/base/result.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// Reads the text of a rules file (RULES.md). Errc::usage has a line `file:line: …` for each of the first
// mistakes: a key, its table, what is wrong and what would be accepted. `file` is its name, for messages.
Result<RuleSet> read_rules(std::string_view text, const std::string& file);

}  // namespace porttape
