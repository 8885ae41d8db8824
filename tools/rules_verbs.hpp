#pragma once

#include <ostream>

#include "tools/verbs.hpp"

namespace porttape {

// The verbs behind `porttape rules`: as those of the program, which find themselves in tools/rules.cpp's
// table.
int run_rules_check(Arguments args, std::ostream& out, std::ostream& err);
int run_rules_infer(Arguments args, std::ostream& out, std::ostream& err);

}  // namespace porttape
