#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"

namespace porttape {

// A checksum at the end of frames (before their line's end): which one, found by what the tape has. A value.
class ChecksumGuess {
 public:
  // The checksum that all frames have right; nothing where none is, or where chance may be the reason (too
  // few different frames).
  static std::optional<ChecksumGuess> of(const std::vector<ByteView>& frames);

  // "XOR", "CRC-16/MODBUS", …
  [[nodiscard]] std::string_view name() const;
  // Where it stands in the frame; nothing where the frame is too short for it.
  struct Field {
    std::size_t at = 0;
    Bytes has;
    Bytes right;
  };
  [[nodiscard]] std::optional<Field> field(ByteView frame) const;

 private:
  ChecksumGuess(std::size_t kind, std::size_t begin, bool separated)
      : kind_(kind), begin_(begin), separated_(separated) {}

  std::size_t kind_;
  std::size_t begin_;  // of the bytes that it is over
  bool separated_;     // they end before a byte that is not among them: `*`, `;`
};

}  // namespace porttape
