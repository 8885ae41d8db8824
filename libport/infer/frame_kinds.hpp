#pragma once

#include <cstddef>
#include <vector>

#include "libport/infer/align.hpp"
#include "libport/infer/findings.hpp"

namespace porttape {

using SessionFrames = std::vector<std::vector<Frame>>;

// The frames of all sessions side by side. Where nothing is known that tells a sort's kinds, bytes that do
// are looked for, and become its key.
std::vector<Column> find_columns(Findings& findings, const SessionFrames& frames);

// Frames that stand side by side.
using Compared = std::vector<ByteView>;

// The columns of one sort that have more than one frame.
std::vector<Compared> columns_of(const std::vector<Column>& columns, const SessionFrames& frames,
                                 std::size_t sort);

// A kind, and where its frames were compared.
struct KindColumns {
  FoundKind kind;
  std::vector<Compared> columns;
};

// Kinds: frames with one key and one size (texts: the same marks), and those that stand beside them.
std::vector<KindColumns> find_kinds(const Findings& findings, const SessionFrames& frames,
                                    const std::vector<Column>& columns);

}  // namespace porttape
