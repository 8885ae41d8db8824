#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/checksum.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// How many bytes the field takes in a frame.
std::size_t size_of(const ChecksumField& field, const ChecksumKind& kind);

// MAVLink's CRC_EXTRA of a message; nothing for one that is not in the common set.
std::optional<Byte> mavlink_crc_extra(std::uint32_t message);

// A checksum of a format, with its place in frames.
class FrameChecksum {
 public:
  // `kind` is that of the field's name.
  FrameChecksum(const ChecksumField& field, const ChecksumKind& kind) : field_(&field), kind_(&kind) {}

  // Where in the frame it stands; nothing where the frame is too short for it.
  struct Span {
    std::size_t begin = 0;
    std::size_t end = 0;
    std::size_t covers_from = 0;
    std::size_t covers_to = 0;
  };
  [[nodiscard]] std::optional<Span> place(ByteView frame) const;
  // What should stand there; hexadecimal digits in the case of those that do, or of `like`, where letters are
  // among these. Nothing: it cannot be told.
  [[nodiscard]] std::optional<Bytes> expected(ByteView frame, ByteView like = {}) const;
  [[nodiscard]] bool holds(ByteView frame) const;
  [[nodiscard]] std::string_view name() const { return kind_->name; }

 private:
  const ChecksumField* field_;
  const ChecksumKind* kind_;
};

}  // namespace porttape
