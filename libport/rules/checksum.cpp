#include "libport/rules/checksum.hpp"

#include <algorithm>
#include <cctype>

#include "libport/rules/frame_place.hpp"

namespace porttape {
namespace {

Bytes as_hex(ByteView bytes, bool upper) {
  const std::string text = to_hex(bytes);
  Bytes out(text.begin(), text.end());
  if (upper)
    std::transform(out.begin(), out.end(), out.begin(),
                   [](Byte digit) { return static_cast<Byte>(std::toupper(digit)); });
  return out;
}

// Upper case where the digits that stand there do not say otherwise.
bool is_upper(ByteView digits) {
  return std::none_of(digits.begin(), digits.end(), [](Byte digit) { return std::islower(digit) != 0; });
}

bool has_letters(ByteView digits) {
  return std::any_of(digits.begin(), digits.end(), [](Byte digit) { return std::isalpha(digit) != 0; });
}

// In a frame of MAVLink, where a signature may follow.
std::optional<std::size_t> behind_payload(ByteView frame) {
  if (frame.size() < 2) return std::nullopt;
  return frame[1] + (frame[0] == 0xfd ? std::size_t{10} : std::size_t{6});
}

// Of the message in a frame of MAVLink 1 or 2 that has its checksum.
std::optional<Byte> extra_of(ByteView frame) {
  if (frame[0] == 0xfe) return mavlink_crc_extra(frame[5]);
  if (frame[0] == 0xfd) {
    return mavlink_crc_extra(frame[7] | static_cast<std::uint32_t>(frame[8]) << 8 |
                             static_cast<std::uint32_t>(frame[9]) << 16);
  }
  return std::nullopt;
}

}  // namespace

std::size_t size_of(const ChecksumField& field, const ChecksumKind& kind) {
  return kind.size() * (field.hex ? 2 : 1);
}

std::optional<FrameChecksum::Span> FrameChecksum::place(ByteView frame) const {
  const auto begin = field_->mavlink_extra ? behind_payload(frame) : position_in(frame.size(), field_->at);
  const auto from = position_in(frame.size(), field_->from);
  const auto to = field_->to ? position_in(frame.size(), *field_->to) : begin;
  if (!begin || !from || !to || *from > *to) return std::nullopt;
  const std::size_t end = *begin + size_of(*field_, *kind_);
  if (end > frame.size()) return std::nullopt;
  return Span{*begin, end, *from, *to};
}

std::optional<Bytes> FrameChecksum::expected(ByteView frame, ByteView like) const {
  const auto span = place(frame);
  if (!span) return std::nullopt;
  std::optional<Byte> extra;
  if (field_->mavlink_extra) {
    extra = extra_of(frame);
    if (!extra) return std::nullopt;
  }
  ByteView covered = frame.subspan(span->covers_from, span->covers_to - span->covers_from);
  Bytes meant;
  if (field_->of_hex) {
    auto bytes = bytes_of_hex(as_text(covered));
    if (!bytes) return std::nullopt;
    covered = meant = std::move(*bytes);
  }
  const std::uint32_t value = checksum_of(*kind_, covered, extra);
  Bytes bytes;
  for (std::size_t i = kind_->size(); i-- > 0;) bytes.push_back(static_cast<Byte>(value >> (8 * i)));
  if (field_->order == ByteOrder::little) std::reverse(bytes.begin(), bytes.end());
  if (!field_->hex) return bytes;
  const ByteView digits = frame.subspan(span->begin, span->end - span->begin);
  return as_hex(bytes, is_upper(has_letters(like) ? like : digits));
}

bool FrameChecksum::holds(ByteView frame) const {
  const auto span = place(frame);
  const auto right = expected(frame);
  return span && right &&
         std::equal(right->begin(), right->end(), frame.begin() + static_cast<std::ptrdiff_t>(span->begin));
}

}  // namespace porttape
