#include "libport/tape/part_writer.hpp"

#include <utility>
#include <variant>

#include "libport/tape/block.hpp"

namespace porttape {

std::uint64_t bytes_in_file(const Record& record) {
  if (record.event != nullptr) return record.event_line.size() + 1;
  return record.data.size() + (record.piece_offset == 0 ? kHeaderSize : 0);
}

TapeHeader made_of(const std::optional<TapeHeader>& told, const std::string& name, std::string by) {
  TapeHeader header = told.value_or(TapeHeader{});
  header.origin = TapeOrigin{std::move(by), {{header.id, name}}, {}};
  header.id.clear();
  header.created.clear();
  header.previous.reset();
  if (!told) header.stamped = Stamped::read;
  return completed(std::move(header));
}

std::string made_line(std::string_view source_line, const TapeHeader& header) {
  std::string line = encode_again(source_line, header);
  line.pop_back();
  return line;
}

Result<PartWriter> PartWriter::begin(const TapeReader& source, const LineState& before,
                                     const Options& options) {
  TapeHeader header = made_of(source.header(), options.name, options.by);
  const Micros from = options.from - TapeTime{};
  const Micros later = options.rebased ? -from : Micros{};
  header.origin->from = from;
  header.previous = options.previous;
  if (header.zero) header.zero = porttape::later(*header.zero, -later);
  Result<NewTape> tape = NewTape::create(options.to, made_line(source.header_line(), header), options.writer);
  if (!tape) return tape.error();
  const TapeTime begin = options.from + later;
  for (const std::string& line : before.lines()) {
    if (Result<void> put = tape->carried_line(begin, line); !put) return put.error();
  }
  return PartWriter(std::move(*tape), header.id.raw(), later);
}

Result<void> PartWriter::copy(const Record& record) {
  const auto* zero = record.event == nullptr ? nullptr : std::get_if<event::Zero>(record.event);
  if (zero != nullptr && later_.count() != 0)
    return tape_.event(record.at + later_, event::Zero{later(zero->zero, -later_)});
  return tape_.copy(record, later_);
}

Result<TapePaths> PartWriter::finish(std::optional<TapeTime> end) {
  return tape_.finish(end ? std::optional(*end + later_) : std::nullopt);
}

}  // namespace porttape
