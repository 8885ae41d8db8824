#include "libport/formats/raw_format.hpp"

#include <array>

#include "libport/formats/each_record.hpp"

namespace porttape {

Result<std::optional<TapeTime>> import_raw(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  to.guessed(to.options().swapped ? "all bytes are the driver's, since raw has no directions"
                                  : "all bytes are the device's, since raw has no directions");
  to.guessed(to.options().bytes_at
                 ? "times are by the line's speed, since raw has none"
                 : "all bytes came at once, since raw has no times; --bytes-at BAUD spreads them");
  constexpr std::size_t kAtOnce = 4096;
  std::array<Byte, kAtOnce> block{};
  const std::size_t most = to.options().bytes_at ? 64 : block.size();
  for (;;) {
    const auto size = from.read(std::span(block).first(most));
    if (!size) return size.error();
    if (*size == 0) break;
    if (Result<void> put = to.block(Direction::read, std::nullopt, ByteView(block).first(*size)); !put)
      return put.error();
    if (progress) progress(from.offset());
  }
  return std::optional(to.latest());
}

Result<std::vector<std::string>> export_raw(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  bool written = false;
  bool events = false;
  const Result<void> all = each_record(from, progress, [&](const Record& record) {
    written |= record.kind == RecordKind::write;
    events |= record.event != nullptr;
    return record.kind == RecordKind::read ? to.add(record.data) : Result<void>();
  });
  if (!all) return all.error();
  std::vector<std::string> lost{"times and blocks"};
  if (written) lost.emplace_back("what the driver wrote");
  if (events) lost.emplace_back("events");
  return lost;
}

}  // namespace porttape
