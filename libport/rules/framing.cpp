#include "libport/rules/framing.hpp"

#include <algorithm>
#include <optional>

#include "libport/rules/frame_place.hpp"

namespace porttape {
namespace {

using State = FrameCut::State;

// So many bytes of no frame are taken together at most.
constexpr std::size_t kMostLoose = 256;

// A frame of `size` bytes, if it fits and has come.
FrameCut sized(const FrameFormat& format, std::size_t size, ByteView bytes, bool ended) {
  if (size == 0 || size > format.longest) return {};
  if (size <= bytes.size()) return {State::frame, size};
  return {ended ? State::none : State::more};
}

FrameCut delimited(const FrameFormat& format, ByteView bytes, bool ended) {
  const ByteView body = bytes.first(std::min(bytes.size(), format.longest)).subspan(format.start.size());
  const auto found = std::search(body.begin(), body.end(), format.end.begin(), format.end.end());
  if (found == body.end()) return {ended || bytes.size() >= format.longest ? State::none : State::more};
  const std::size_t end =
      format.start.size() + static_cast<std::size_t>(found - body.begin()) + format.end.size();
  return sized(format, end + format.trailer, bytes, ended);
}

std::uint64_t number_at(const LengthField& field, ByteView bytes) {
  std::uint64_t value = 0;
  for (std::int64_t i = 0; i < field.size; ++i) {
    const std::int64_t byte = field.order == ByteOrder::big ? i : field.size - 1 - i;
    value = value << 8 | bytes[static_cast<std::size_t>(field.at + byte)];
  }
  return value;
}

FrameCut by_length(const FrameFormat& format, ByteView bytes, bool ended) {
  const LengthField& field = format.length;
  const std::int64_t signed_end = field.signed_at ? *field.signed_at + 1 : 0;
  const auto header = static_cast<std::size_t>(std::max(field.at + field.size, signed_end));
  if (bytes.size() < header) return {ended ? State::none : State::more};
  constexpr std::int64_t kSignature = 13;
  const bool is_signed = field.signed_at && (bytes[static_cast<std::size_t>(*field.signed_at)] & 1) != 0;
  const std::int64_t size =
      static_cast<std::int64_t>(number_at(field, bytes)) + field.adds + (is_signed ? kSignature : 0);
  if (size < static_cast<std::int64_t>(header)) return {};
  return sized(format, static_cast<std::size_t>(size), bytes, ended);
}

FrameCut begun(const FrameFormat& format, ByteView bytes, bool ended) {
  switch (format.kind) {
    case FrameFormat::Kind::delimited:
      return delimited(format, bytes, ended);
    case FrameFormat::Kind::length:
      return by_length(format, bytes, ended);
    case FrameFormat::Kind::fixed:
      return sized(format, format.size, bytes, ended);
    case FrameFormat::Kind::idle:
      break;
  }
  if (bytes.size() > format.longest) return {};
  return ended ? FrameCut{State::frame, bytes.size()} : FrameCut{State::more};
}

FrameCut first_frame(std::span<const FrameFormat> formats, ByteView bytes, bool ended) {
  for (std::size_t i = 0; i < formats.size(); ++i) {
    FrameCut cut = cut_frame(formats[i], bytes, ended);
    if (cut.state == State::none) continue;
    cut.format = static_cast<int>(i);
    return cut;
  }
  return {};
}

}  // namespace

FrameCut cut_frame(const FrameFormat& format, ByteView bytes, bool ended) {
  const std::size_t shown = std::min(bytes.size(), format.start.size());
  if (!std::equal(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(shown), format.start.begin()))
    return {};
  if (shown < format.start.size()) return {ended ? State::none : State::more};
  return begun(format, bytes, ended);
}

FrameCut cut_frame(std::span<const FrameFormat> formats, ByteView bytes, bool ended) {
  FrameCut cut = first_frame(formats, bytes, ended);
  if (cut.state != State::none) return cut;
  cut.size = 1;
  while (cut.size < std::min(bytes.size(), kMostLoose) &&
         first_frame(formats, bytes.subspan(cut.size), ended).state == State::none) {
    ++cut.size;
  }
  return cut;
}

}  // namespace porttape
