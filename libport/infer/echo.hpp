#pragma once

#include <span>

#include "libport/infer/findings.hpp"

namespace porttape {

// Finds what the device answered first to each frame, for Findings::answers.
void find_answers(Findings& findings, std::span<const SessionTape> sessions);

// Whether every answer to these frames has at the same place what the request has in the field, and not
// always the same.
bool is_echoed(const Findings& findings, std::size_t sort, std::span<const FrameRun> runs,
               const FoundField& field);

}  // namespace porttape
