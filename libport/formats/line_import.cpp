#include "libport/formats/line_import.hpp"

#include <limits>
#include <utility>

namespace porttape {
namespace {

constexpr std::uint64_t kMostOfBlock = std::numeric_limits<std::uint32_t>::max();

}  // namespace

Result<std::optional<TapeTime>> LineImport::run(const ConvertProgress& progress) {
  for (;;) {
    const auto next = from_.line();
    if (!next) return next.error();
    if (!*next) break;
    line_ = **next;
    to_.at_line(line_.number);
    if (Result<void> taken = take_line(); !taken) return taken.error();
    if (progress) progress(from_.offset());
  }
  if (Result<void> ended = at_end(); !ended) return ended.error();
  return end_;
}

Result<void> LineImport::placed(Result<void> put, std::size_t column) const {
  if (!put && put.error().code == Errc::usage) return wrong(column, put.error().message);
  return put;
}

Result<void> LineImport::begin_record() {
  if (Result<void> put = put_block(); !put) return put;
  if (end_) return wrong(0, "something behind the end");
  return {};
}

Result<void> LineImport::take_header(std::string_view header, std::size_t column) {
  if (!to_.empty()) return wrong(0, "the header stands before all records");
  const Result<void> taken = to_.header_line(header);
  return taken ? taken : Result<void>(wrong(column, taken.error().message));
}

Result<void> LineImport::take_event(std::optional<TapeTime> at, std::string_view object, std::size_t column) {
  const auto event = decode_event(object);
  if (!event) return wrong(column, event.error().message);
  const TapeTime time = at.value_or(event->at);
  if (!std::holds_alternative<event::End>(event->what)) return placed(to_.event_line(time, object), column);
  end_at(time);
  return {};
}

void LineImport::begin_block(Direction direction, TapeTime at) {
  block_ = Block{direction, at, line_.number};
}

Result<void> LineImport::add_to_block(ByteView bytes, std::size_t column) {
  if (data_.size() + bytes.size() > kMostOfBlock) return wrong(column, "a block of 4 GiB or more");
  return data_.add(bytes);
}

Result<void> LineImport::put_data(const Block& block) {
  if (data_.all_kept()) return to_.block(block.direction, block.at, data_.kept());
  const auto length = static_cast<std::uint32_t>(data_.size());
  if (Result<void> begun = to_.begin_block(block.direction, block.at, length); !begun) return begun;
  return data_.each_piece([this](ByteView piece) { return to_.add(piece); });
}

Result<void> LineImport::put_block() {
  if (!block_) return {};
  const Block block = *std::exchange(block_, std::nullopt);
  to_.at_line(block.line);
  const Result<void> put = put_data(block);
  to_.at_line(line_.number);
  data_.clear();
  return placed(put);
}

}  // namespace porttape
