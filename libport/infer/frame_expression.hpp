#pragma once

#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/infer/findings.hpp"

namespace porttape {

// Regular expressions for a rules file (RE2, of bytes), made of what was found.

// These bytes and nothing else.
std::string literal_expression(ByteView bytes);

// Finds the frames of a kind among those of its sort: as little of their begin as tells them from the others.
std::string kind_expression(const Findings& findings, const FoundKind& kind);

// This whole frame, but for what of its kind differs between sessions and what follows from that.
std::string frame_expression(const FoundSort& sort, const FoundKind& kind, ByteView frame);

// The same for its first words up to the one that the field is in, of which the first group is what differs.
std::string word_expression(const FoundKind& kind, const FoundField& field);

}  // namespace porttape
