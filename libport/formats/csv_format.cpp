#include "libport/formats/csv_format.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/formats/byte_text.hpp"
#include "libport/formats/csv_cells.hpp"
#include "libport/formats/each_record.hpp"
#include "libport/formats/line_import.hpp"

namespace porttape {
namespace {

constexpr std::array<std::string_view, 3> kColumns{"seconds", "kind", "data"};
constexpr std::string_view kFirst = "seconds,kind,data";

std::string in_cell(std::string_view text) {
  std::string cell = "\"";
  for (const char c : text) {
    if (c == '"') cell += '"';
    cell += c;
  }
  return cell + '"';
}

class CsvImport final : public LineImport {
 public:
  CsvImport(Evidence& from, ImportTape& to) : LineImport(from, to) {}

 private:
  Result<void> take_line() override {
    if (line().text.empty()) return {};
    const auto cells = csv_cells_of(line().text);
    if (!cells) return wrong(0, "a quote is not closed");
    return named_ ? take_row(*cells) : take_names(*cells);
  }

  Result<void> take_names(const std::vector<CsvCell>& cells) {
    for (std::size_t i = 0; i < kColumns.size(); ++i) {
      const auto found = std::ranges::find(cells, kColumns.at(i), &CsvCell::text);
      if (found == cells.end())
        return make_error(Errc::not_a_tape,
                          fmt::format("{}:{}: not a tape's CSV: its first line names no column \"{}\"",
                                      evidence().name(), line().number, kColumns.at(i)));
      place_.at(i) = static_cast<std::size_t>(found - cells.begin());
    }
    named_ = true;
    tape().sure();
    return {};
  }

  Result<void> take_row(const std::vector<CsvCell>& cells) {
    if (cells.size() <= std::ranges::max(place_))
      return wrong(line().text.size(),
                   fmt::format("{} cells, and {} are expected", cells.size(), std::ranges::max(place_) + 1));
    const CsvCell& kind = cells[place_[1]];
    const CsvCell& data = cells[place_[2]];
    if (kind.text == "more") return more_bytes(data);
    if (Result<void> begun = begin_record(); !begun) return begun;
    if (kind.text == "header") return take_header(data.text, data.column);
    const CsvCell& time = cells[place_[0]];
    std::string_view seconds = time.text;
    const auto us = take_seconds_us(seconds);
    if (!us || !seconds.empty())
      return wrong(time.column, "a time is expected, in seconds with up to 6 decimals: 12.000345");
    const TapeTime at = tape_time_us(*us);
    if (kind.text == "event") return take_event(at, data.text, data.column);
    if (kind.text == "end") {
      end_at(at);
      return {};
    }
    if (kind.text != "r" && kind.text != "w")
      return wrong(kind.column, fmt::format("{} is unknown; accepted: r, w, more, event, header, end",
                                            in_quotes(kind.text)));
    begin_block(kind.text == "r" ? Direction::read : Direction::write, at);
    return more_bytes(data);
  }

  Result<void> more_bytes(const CsvCell& data) {
    if (!in_block()) return wrong(data.column, "more bytes without a block");
    const auto bytes = bytes_of_hex(data.text);
    if (!bytes) return wrong(data.column, "pairs of hexadecimal digits are expected");
    return add_to_block(*bytes, data.column);
  }

  bool named_ = false;
  std::array<std::size_t, kColumns.size()> place_{};
};

std::string row_of(const Record& record) {
  const std::string time = seconds_of_us(to_us(record.at));
  if (record.event != nullptr && std::holds_alternative<event::End>(*record.event)) return time + ",end,\n";
  if (record.event != nullptr)
    return fmt::format("{},event,{}\n", time, in_cell(json_for_terminal(record.event_line)));
  const std::string_view way = record.kind == RecordKind::read ? "r" : "w";
  return fmt::format("{},{},{}\n", time, record.piece_offset > 0 ? "more" : way, to_hex(record.data));
}

}  // namespace

Result<std::optional<TapeTime>> import_csv(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return CsvImport(from, to).run(progress);
}

Result<std::vector<std::string>> export_csv(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  std::string text = std::string(kFirst) + '\n';
  if (const std::string header = from.header_line(); !header.empty())
    text += ",header," + in_cell(json_for_terminal(header)) + '\n';
  if (Result<void> added = to.add(text); !added) return added.error();
  const Result<void> all =
      each_record(from, progress, [&](const Record& record) { return to.add(row_of(record)); });
  if (!all) return all.error();
  return std::vector<std::string>{};
}

int detect_csv(std::string_view head) { return head.starts_with(kFirst) ? 95 : 0; }

}  // namespace porttape
