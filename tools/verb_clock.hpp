#pragma once

#include "libport/base/clock.hpp"

namespace porttape {

// The clock of a verb's own waits and durations: how long other processes of this machine may take to answer
// or to end, how long a run took, how often progress is shown. What a command under test gets to see goes by
// the clock of its Loop instead.
const Clock& verb_clock();

}  // namespace porttape
