#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/formats/csv_cells.hpp"
#include "libport/formats/saleae_format.hpp"
#include "libport/formats/saleae_value.hpp"
#include "libport/formats/tape_wall.hpp"
#include "libport/formats/uart_options.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostOfBlockOfRows = 4096;

// What a column is, whatever version of Logic names it.
enum class SaleaeColumn : std::uint8_t { time, value, name, type, duration, parity, framing, error, other };

SaleaeColumn saleae_column(std::string_view name) {
  using C = SaleaeColumn;
  constexpr std::array<std::pair<std::string_view, C>, 12> kNames = {{{"Time [s]", C::time},
                                                                      {"start_time", C::time},
                                                                      {"Value", C::value},
                                                                      {"data", C::value},
                                                                      {"Decoded Protocol Result", C::value},
                                                                      {"name", C::name},
                                                                      {"Analyzer Name", C::name},
                                                                      {"type", C::type},
                                                                      {"duration", C::duration},
                                                                      {"Parity Error", C::parity},
                                                                      {"Framing Error", C::framing},
                                                                      {"error", C::error}}};
  for (const auto& [each, column] : kNames) {
    if (each == name) return column;
  }
  return C::other;
}

std::string_view first_line(std::string_view head) {
  head = head.substr(0, head.find('\n'));
  if (head.starts_with("\xef\xbb\xbf")) head.remove_prefix(3);
  if (head.ends_with('\r')) head.remove_suffix(1);
  return head;
}

std::optional<std::int64_t> micros_of(std::string_view seconds) {
  double number = 0;
  const auto [end, error] = std::from_chars(seconds.data(), seconds.data() + seconds.size(), number);
  if (error != std::errc() || end != seconds.data() + seconds.size() || !(std::abs(number) < 4e9))
    return std::nullopt;
  return std::llround(number * 1e6);
}

bool has_word(std::string_view name, std::string_view word) {
  std::string small(name);
  std::ranges::transform(small, small.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return small.find(word) != std::string::npos;
}

class SaleaeImport {
 public:
  SaleaeImport(Evidence& from, ImportTape& to) : from_(from), to_(to) {}

  Result<std::optional<TapeTime>> run(const ConvertProgress& progress) {
    Result<UartOptions> options = UartOptions::parse(to_.options().device.value_or(""));
    if (!options) return options.error();
    options_ = std::move(*options);
    if (to_.options().bytes_at) byte_us_ = 10'000'000 / *to_.options().bytes_at;
    if (Result<void> looked = look_at_values(); !looked) return looked.error();
    for (;;) {
      const auto next = from_.line();
      if (!next) return next.error();
      if (!*next) break;
      line_ = **next;
      if (line_.text.empty()) continue;
      const auto cells = csv_cells_of(line_.text);
      if (!cells) return wrong(0, "a quote is not closed");
      if (Result<void> taken = columns_.empty() ? take_names(*cells) : take_row(*cells); !taken)
        return taken.error();
      if (progress) progress(from_.offset());
    }
    if (columns_.empty()) return make_error(Errc::not_a_tape, from_.name() + " is empty");
    if (Result<void> put = put_block(); !put) return put.error();
    return std::optional(to_.latest());
  }

 private:
  using C = SaleaeColumn;

  [[nodiscard]] Error wrong(std::size_t column, const std::string& what) const {
    return from_.error_at(line_, column, what);
  }

  // One digit alone is a character, but in a table of decimal numbers.
  Result<void> look_at_values() {
    const auto head = from_.peek();
    if (!head) return head.error();
    std::string_view text = as_text(*head);
    std::optional<std::size_t> at;
    bool long_number = false;
    bool other = false;
    while (!text.empty()) {
      const std::string_view line = first_line(text);
      const bool whole = text.find('\n') != std::string_view::npos;
      text.remove_prefix(whole ? text.find('\n') + 1 : text.size());
      const auto cells = csv_cells_of(line);
      if (!cells) continue;
      for (std::size_t i = 0; !at && i < cells->size(); ++i) {
        if (saleae_column((*cells)[i].text) == C::value) at = i;
      }
      if (!at || *at >= cells->size() || saleae_column((*cells)[*at].text) == C::value) continue;
      const std::string& value = (*cells)[*at].text;
      const bool number = value.find_first_not_of("0123456789") == std::string::npos;
      long_number |= number && value.size() > 1;
      other |= !number;
    }
    decimal_ = long_number && !other;
    return {};
  }

  Result<void> take_names(const std::vector<CsvCell>& cells) {
    std::size_t wanted = 0;
    for (const CsvCell& cell : cells) {
      std::string_view name = cell.text;
      if (name.starts_with("\xef\xbb\xbf")) name.remove_prefix(3);
      while (name.starts_with(' ')) name.remove_prefix(1);
      columns_.push_back(saleae_column(name));
      if (columns_.back() == C::time || columns_.back() == C::value) ++wanted;
    }
    if (wanted == 2) return {};
    return make_error(Errc::not_a_tape,
                      from_.name() +
                          " is no table of Saleae's: its first line does not name \"Time [s]\" and "
                          "\"Value\", or \"start_time\" and \"data\"");
  }

  Result<void> take_row(const std::vector<CsvCell>& cells) {
    const auto cell = [&](C column) -> const CsvCell* {
      for (std::size_t i = 0; i < std::min(cells.size(), columns_.size()); ++i) {
        if (columns_[i] == column) return &cells[i];
      }
      return nullptr;
    };
    const auto text = [&](C column) {
      const CsvCell* const found = cell(column);
      return found == nullptr ? std::string_view() : std::string_view(found->text);
    };
    if (const std::string_view type = text(C::type); !type.empty() && type != "data") return {};
    if (cell(C::time) == nullptr || cell(C::value) == nullptr)
      return wrong(0, "fewer cells than the first line has");
    const auto us = time_of(text(C::time));
    if (!us) return wrong(cell(C::time)->column, "no time: seconds are expected, or an RFC 3339 time");
    const auto byte = saleae_value(text(C::value), decimal_);
    if (!byte) return wrong(cell(C::value)->column, "no byte: 0x41 is expected, 'A' (0x41), 65 or A");
    const auto way = way_of(text(C::name));
    if (!way) return {};
    for (const auto& [column, what] :
         {std::pair(C::parity, "parity"), {C::framing, "framing"}, {C::error, "an"}}) {
      const std::string_view told = text(column);
      if (!told.empty() && told != "false" && errors_++ == 0)
        to_.problem(fmt::format("{}:{}: a byte with {} error{}; it stays as it is", from_.name(),
                                line_.number, what,
                                column == C::error ? " (" + printable_line(told) + ")" : ""));
    }
    const auto duration = micros_of(text(C::duration));
    return take_byte(*way, *us, duration && *duration > 0 ? *duration : byte_us_, *byte);
  }

  // Since the tape's zero.
  std::optional<std::int64_t> time_of(std::string_view text) {
    if (text.find('T') == std::string_view::npos) {
      const auto us = micros_of(text);
      if (!us) return std::nullopt;
      if (!zero_us_) zero_us_ = std::min<std::int64_t>(*us, 0);  // times before a trigger are negative
      return *us - *zero_us_;
    }
    const TapeZero wall{std::string(text), 0, ""};
    if (zero_wall_.empty()) {
      const auto known = since({"1970-01-01T00:00:00Z", 0, ""}, wall);
      if (!known) return std::nullopt;
      zero_wall_ = wall_text(*known);
      to_.wall_of_zero(zero_wall_);
    }
    const auto us = since({zero_wall_, 0, ""}, wall);
    return us ? std::optional(us->count()) : std::nullopt;
  }

  // Nothing: an analyzer that is not wanted.
  std::optional<Direction> way_of(std::string_view name) {
    if (!options_.rx.empty() || !options_.tx.empty()) {
      if (name == options_.rx) return Direction::read;
      return name == options_.tx ? std::optional(Direction::write) : std::nullopt;
    }
    if (has_word(name, "tx")) return Direction::write;
    if (!has_word(name, "rx"))
      to_.guessed(fmt::format("bytes of {} are the device's; --device rx=NAME,tx=NAME says otherwise",
                              name.empty() ? "an analyzer without a name" : in_quotes(name)));
    return Direction::read;
  }

  Result<void> take_byte(Direction way, std::int64_t us, std::int64_t byte_us, Byte byte) {
    const bool joins = !block_.empty() && way == way_ && us - end_us_ <= 2 * byte_us &&
                       us >= end_us_ - byte_us && byte_us > 0 && block_.size() < kMostOfBlockOfRows;
    if (!joins) {
      if (Result<void> put = put_block(); !put) return put;
      way_ = way;
      begin_us_ = us;
    }
    block_.push_back(byte);
    end_us_ = us + byte_us;
    return {};
  }

  // What was read came at its end.
  Result<void> put_block() {
    if (block_.empty()) return {};
    if (byte_us_ == 0 && end_us_ == begin_us_)
      to_.guessed("each byte is a block; --bytes-at BAUD joins them");
    const std::int64_t at = way_ == Direction::read ? end_us_ : begin_us_;
    // The other direction's may have begun while this one went on.
    const TapeTime time = std::max(tape_time_us(at), to_.latest());
    return to_.block(way_, time, std::exchange(block_, {}));
  }

  Evidence& from_;
  ImportTape& to_;
  UartOptions options_;
  Evidence::Line line_;
  std::vector<C> columns_;
  bool decimal_ = false;
  std::int64_t byte_us_ = 0;
  std::optional<std::int64_t> zero_us_;
  std::string zero_wall_;
  Direction way_ = Direction::read;
  Bytes block_;
  std::int64_t begin_us_ = 0;
  std::int64_t end_us_ = 0;
  std::uint64_t errors_ = 0;
};

}  // namespace

Result<std::optional<TapeTime>> import_saleae(Evidence& from, ImportTape& to,
                                              const ConvertProgress& progress) {
  return SaleaeImport(from, to).run(progress);
}

int detect_saleae(std::string_view head) {
  const auto cells = csv_cells_of(first_line(head));
  if (!cells || cells->size() > 64) return 0;
  bool time = false;
  bool value = false;
  bool known = false;
  for (const CsvCell& cell : *cells) {
    std::string_view name = cell.text;
    while (name.starts_with(' ')) name.remove_prefix(1);
    const SaleaeColumn column = saleae_column(name);
    time |= column == SaleaeColumn::time;
    value |= column == SaleaeColumn::value;
    known |= name == "Time [s]" || name == "start_time";
  }
  return time && value && known ? 95 : 0;
}

}  // namespace porttape
