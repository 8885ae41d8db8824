#pragma once

#include <array>
#include <cstdint>

#include "libport/base/bytes.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// What stands in a secret's place: as long, never the secret itself, the same for the same secret, and
// without the key nothing that tells of it. A value; never changes.
class Filler {
 public:
  using Key = std::array<std::uint64_t, 2>;  // random, and never told

  // Of these formats' delimiters none comes into being.
  Filler(Key key, const std::vector<FrameFormat>& formats);

  // `text`: it is a part of a text, where only ASCII may stand.
  [[nodiscard]] Bytes fill(const RedactRule& rule, ByteView secret, bool text = false) const;

 private:
  [[nodiscard]] Bytes of_alphabet(FillerKind kind, ByteView secret) const;

  Key key_;
  Bytes plain_;  // the bytes of FillerKind::bytes
};

// SipHash-2-4, a keyed hash whose key cannot be told from what it gives.
std::uint64_t sip_hash(const Filler::Key& key, ByteView data);

}  // namespace porttape
