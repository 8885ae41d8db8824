#pragma once

#include <ostream>

#include "libport/base/result.hpp"
#include "tools/command_verb.hpp"
#include "tools/supervision.hpp"

namespace porttape {

// The verbs `record` and `test` by their options: --record-mode leads from each to the other, and `exec` with
// a device and a tape to the first.
Result<int> record_command(CommandVerbLine line, std::ostream& err);
Result<int> record_supervised(CommandVerbLine line, const Supervision& supervision, std::ostream& err);
Result<int> play_command(CommandVerbLine line, std::ostream& out, std::ostream& err);

}  // namespace porttape
