#include "libport/rules/framing.hpp"

#include <algorithm>
#include <cstring>
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

// What is looked at: a format, and the bytes from the place on at which its frame would begin.
struct Begin {
  const FrameFormat& format;
  std::size_t number;  // of the format
  ByteView all;
  std::size_t at;
  bool ended;

  [[nodiscard]] ByteView bytes() const { return all.subspan(at); }
};

FrameCut delimited(const Begin& begin, DelimiterSearch& ends) {
  const FrameFormat& format = begin.format;
  const ByteView bytes = begin.bytes();
  const std::size_t to = begin.at + std::min(bytes.size(), format.longest);
  const auto over = ends.find(begin.number, format.end, begin.all, begin.at + format.start.size(), to);
  if (!over) return {begin.ended || bytes.size() >= format.longest ? State::none : State::more};
  return sized(format, *over - begin.at + format.trailer, bytes, begin.ended);
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

FrameCut begun(const Begin& begin, DelimiterSearch& ends) {
  const FrameFormat& format = begin.format;
  const ByteView bytes = begin.bytes();
  switch (format.kind) {
    case FrameFormat::Kind::delimited:
      return delimited(begin, ends);
    case FrameFormat::Kind::length:
      return by_length(format, bytes, begin.ended);
    case FrameFormat::Kind::fixed:
      return sized(format, format.size, bytes, begin.ended);
    case FrameFormat::Kind::idle:
      break;
  }
  if (bytes.size() > format.longest) return {};
  return begin.ended ? FrameCut{State::frame, bytes.size()} : FrameCut{State::more};
}

FrameCut cut_at(const Begin& begin, DelimiterSearch& ends) {
  const ByteView bytes = begin.bytes();
  const Bytes& start = begin.format.start;
  const std::size_t shown = std::min(bytes.size(), start.size());
  if (!std::equal(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(shown), start.begin()))
    return {};
  if (shown < start.size()) return {begin.ended ? State::none : State::more};
  return begun(begin, ends);
}

FrameCut first_frame(std::span<const FrameFormat> formats, ByteView bytes, std::size_t at, bool ended,
                     DelimiterSearch& ends) {
  for (std::size_t i = 0; i < formats.size(); ++i) {
    FrameCut cut = cut_at({formats[i], i, bytes, at, ended}, ends);
    if (cut.state == State::none) continue;
    cut.format = static_cast<int>(i);
    return cut;
  }
  return {};
}

}  // namespace

std::optional<std::size_t> DelimiterSearch::find(std::size_t format, ByteView end, ByteView bytes,
                                                 std::size_t from, std::size_t to) {
  if (known_.size() <= format) known_.resize(format + 1);
  Known& known = known_[format];
  if (known.begin && *known.begin < from) known.begin.reset();
  const std::size_t begin = std::max(from, known.searched);
  if (!known.begin && begin < to) {
    const void* found = ::memmem(bytes.data() + begin, to - begin, end.data(), end.size());
    if (found != nullptr)
      known.begin = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - bytes.data());
  }
  known.searched = std::max(known.searched, known.begin.value_or(to + 1 - std::min(to + 1, end.size())));
  if (!known.begin || *known.begin + end.size() > to) return std::nullopt;
  return *known.begin + end.size();
}

FrameCut FrameCutter::cut(ByteView bytes, std::size_t at, bool ended) {
  FrameCut cut = first_frame(formats_, bytes, at, ended, ends_);
  if (cut.state != State::none) return cut;
  const std::size_t most = std::min(bytes.size() - at, kMostLoose);
  cut.size = 1;
  while (cut.size < most && first_frame(formats_, bytes, at + cut.size, ended, ends_).state == State::none)
    ++cut.size;
  return cut;
}

FrameCut cut_frame(const FrameFormat& format, ByteView bytes, bool ended) {
  DelimiterSearch ends;
  return cut_at({format, 0, bytes, 0, ended}, ends);
}

FrameCut cut_frame(std::span<const FrameFormat> formats, ByteView bytes, bool ended) {
  return FrameCutter(formats).cut(bytes, 0, ended);
}

}  // namespace porttape
