#pragma once

#include <ostream>

#include "libport/base/result.hpp"
#include "tools/command_verb.hpp"

namespace porttape {

// The verbs `record` and `test` by their options: --record-mode leads from each to the other.
Result<int> record_command(const CommandVerbLine& line, std::ostream& err);
Result<int> play_command(CommandVerbLine line, std::ostream& out, std::ostream& err);

}  // namespace porttape
