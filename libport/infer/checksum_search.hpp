#pragma once

#include <optional>
#include <span>

#include "libport/base/bytes.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// Where all of these frames have a checksum of the catalogue, if it cannot be chance: that the sums of so
// many different frames are all right must be far less likely than one of the places that are tried. Tried
// are all kinds, sums at most 4 bytes before a frame's end, over what begins in its first 9 bytes and ends at
// most 2 before the sum.
std::optional<ChecksumField> find_checksum_field(std::span<const ByteView> frames);

// Whether at least `share` of these frames have it right.
bool checksum_holds(const ChecksumField& field, std::span<const ByteView> frames, double share);

}  // namespace porttape
