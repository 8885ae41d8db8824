#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "libport/replay/report.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What of a run leaves its verdict in doubt, as its report tells it.

// The first `reached` of the tape's gaps, which the run came to. The first few are told one by one.
void add_gaps(RunReport& report, const std::vector<TapeGap>& gaps, std::size_t reached);
// So often something came behind a frame that was left out, and it is not known whether it answers that.
void add_doubtful_answers(RunReport& report, std::uint64_t answers);

}  // namespace porttape
