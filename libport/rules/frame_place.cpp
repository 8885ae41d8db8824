#include "libport/rules/frame_place.hpp"

#include <algorithm>
#include <array>
#include <string_view>

namespace porttape {
namespace {

// Where the columns of a frame end: before its checksum, and what ends it.
std::size_t end_of_columns(const FrameFormat* format, std::size_t size) {
  if (format == nullptr) return size;
  std::size_t end = size;
  if (format->kind == FrameFormat::Kind::delimited) {
    const std::size_t behind = format->end.size() + format->trailer;
    end -= std::min(end, behind);
  }
  if (format->checksum) {
    const std::int64_t begin = format->checksum->to.value_or(format->checksum->at);
    if (begin < 0) end = std::min(end, position_in(size, begin).value_or(end));
  }
  return end;
}

std::optional<FrameSpan> column_of(const Place& place, const FrameFormat* format, ByteView frame) {
  const std::size_t end = end_of_columns(format, frame.size());
  const std::string_view text = as_text(frame.first(end));
  std::size_t begin = 0;
  for (int column = 0; column < place.column; ++column) {
    const std::size_t separator = text.find(place.separator, begin);
    if (separator == std::string_view::npos) return std::nullopt;
    begin = separator + place.separator.size();
  }
  return FrameSpan{begin, std::min(text.find(place.separator, begin), end)};
}

std::optional<FrameSpan> captured(const re2::RE2& expression, ByteView frame) {
  std::array<re2::StringPiece, 2> groups;
  const re2::StringPiece text = as_piece(frame);
  if (!expression.Match(text, 0, text.size(), re2::RE2::UNANCHORED, groups.data(), 2)) return std::nullopt;
  if (groups[1].data() == nullptr) return std::nullopt;
  const auto begin = static_cast<std::size_t>(groups[1].data() - text.data());
  return FrameSpan{begin, begin + groups[1].size()};
}

}  // namespace

std::optional<std::size_t> position_in(std::size_t size, std::int64_t at) {
  const auto whole = static_cast<std::int64_t>(size);
  if (at > whole || at < -whole) return std::nullopt;
  return static_cast<std::size_t>(at < 0 ? whole + at : at);
}

std::optional<FrameSpan> locate(const Place& place, const re2::RE2* capture, const FrameFormat* format,
                                ByteView frame) {
  if (place.by == Place::By::column) return column_of(place, format, frame);
  if (place.by == Place::By::capture) return capture == nullptr ? std::nullopt : captured(*capture, frame);
  const auto begin = position_in(frame.size(), place.at);
  if (!begin) return std::nullopt;
  std::optional<std::size_t> end = frame.size();
  if (place.to) end = position_in(frame.size(), *place.to);
  if (place.size) end = *begin + static_cast<std::size_t>(*place.size);
  if (!end || *end < *begin || *end > frame.size()) return std::nullopt;
  return FrameSpan{*begin, *end};
}

re2::RE2::Options rule_expression_options(std::size_t count) {
  // With less than the least an expression that the reader accepts cannot be compiled.
  constexpr std::size_t kAll = std::size_t{1} << 28;
  constexpr std::size_t kLeast = std::size_t{1} << 18;
  constexpr std::size_t kMost = std::size_t{1} << 22;
  re2::RE2::Options options(re2::RE2::Latin1);
  options.set_log_errors(false);
  options.set_dot_nl(true);
  options.set_max_mem(
      static_cast<std::int64_t>(std::clamp(kAll / std::max<std::size_t>(count, 1), kLeast, kMost)));
  return options;
}

}  // namespace porttape
