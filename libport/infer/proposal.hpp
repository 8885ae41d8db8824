#pragma once

#include <string>
#include <vector>

#include "libport/infer/findings.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// Rules that let vary what was found to, and no more; and for each what speaks for it, for a person.
struct Proposal {
  RuleSet rules;
  std::vector<std::string> reasons;
};
Proposal propose(const Findings& findings);

}  // namespace porttape
