#include "libport/formats/dialect_format.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <map>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/formats/dialect.hpp"
#include "libport/formats/line_import.hpp"
#include "libport/formats/shipped_dialects.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostOfRows = 65'536;

// "all bytes are the device's", which --swap makes the driver's.
std::string swapped_guess(std::string guess) {
  constexpr std::string_view kDevices = "the device's";
  const std::size_t at = guess.find(kDevices);
  return at == std::string::npos ? guess : guess.replace(at, kDevices.size(), "the driver's");
}

class DialectImport final : public LineImport {
 public:
  DialectImport(const Dialect& dialect, Evidence& from, ImportTape& to)
      : LineImport(from, to), dialect_(dialect) {
    to.keep_order();
  }

 private:
  Result<void> take_line() override {
    const std::string plain = without_colors(line().text);
    Dialect::Found found = dialect_.find(plain);
    switch (found.what) {
      case Dialect::Found::What::bytes:
        return take_bytes(std::move(found));
      case Dialect::Found::What::damaged:
        tape().problem_of_line(line().number, "bytes are damaged; left out");
        break;
      case Dialect::Found::What::unknown:
        if (!plain.empty()) tape().problem_of_line(line().number, "something else; left out");
        break;
      case Dialect::Found::What::nothing:
        break;
    }
    return put_rows();
  }

  Result<void> at_end() override {
    if (Result<void> put = put_rows(); !put) return put;
    for (const std::string& guess : dialect_.guesses())
      tape().guessed(tape().options().swapped ? swapped_guess(guess) : guess);
    if (!clock_.first() && !tape().empty())
      tape().guessed(tape().options().bytes_at
                         ? "times are by the line's speed, since the log has none"
                         : "all came at once, since the log has no times; --bytes-at BAUD spreads it");
    end_at(tape().latest());
    return {};
  }

  Result<void> take_bytes(Dialect::Found found) {
    const auto at = found.time ? time_of(*found.time) : std::nullopt;
    const bool goes_on =
        rows_open_ && direction_ == *found.direction && (!at || at == at_) && rows_.size() < kMostOfRows;
    if (!goes_on) {
      if (Result<void> put = put_rows(); !put) return put;
      direction_ = *found.direction;
      at_ = at;
      first_line_ = line().number;
    }
    append(rows_, found.bytes);
    rows_open_ = found.goes_on;
    return rows_open_ ? Result<void>() : put_rows();
  }

  Result<void> put_rows() {
    rows_open_ = false;
    if (rows_.empty()) return {};
    tape().at_line(first_line_);
    return placed(tape().block(direction_, at_, std::exchange(rows_, {})));
  }

  std::optional<TapeTime> time_of(std::string_view text) {
    const auto parsed = parse_log_time(text, dialect_.unit());
    if (!parsed) {
      tape().problem_of_line(line().number, "no time");
      return std::nullopt;
    }
    const bool first = !clock_.first();
    const auto us = clock_.since_first(*parsed);
    if (first && parsed->kind == LogTime::Kind::epoch) {
      tape().wall_of_zero(wall_text(Micros(parsed->us)));
      if (!parsed->zoned) tape().guessed("its times are UTC");
    }
    return us ? std::optional(tape_time_us(*us)) : std::nullopt;
  }

  const Dialect& dialect_;
  LogClock clock_;
  Direction direction_ = Direction::read;
  std::optional<TapeTime> at_;
  Bytes rows_;  // of a block that is not whole yet
  bool rows_open_ = false;
  std::uint64_t first_line_ = 0;  // of the rows
};

// Expressions take long to compile: once.
const Result<Dialect>& shipped(std::string_view name) {
  static const std::map<std::string_view, Result<Dialect>> all = [] {
    std::map<std::string_view, Result<Dialect>> dialects;
    for (const ShippedDialect& each : shipped_dialects())
      dialects.emplace(each.name, Dialect::parse(std::string(each.toml), std::string(each.name)));
    return dialects;
  }();
  return all.at(name);
}

}  // namespace

Result<std::optional<TapeTime>> import_dialect(Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress) {
  constexpr std::size_t kLargestDialect = std::size_t{64} << 10U;
  const std::string file = to.options().dialect.value_or("");
  if (file.empty()) return make_error(Errc::usage, "a dialect is named by its file: --from FILE.toml");
  Result<Evidence> text = Evidence::open(file);
  if (!text) return text.error();
  Bytes bytes(kLargestDialect);
  const auto size = text->read(bytes);
  if (!size) return size.error();
  if (*size == kLargestDialect)
    return make_error(Errc::usage, fmt::format("{} is over 64 KiB; it is no dialect", in_quotes(file)));
  const Result<Dialect> dialect = Dialect::parse(std::string(as_text(ByteView(bytes).first(*size))), file);
  if (!dialect) return dialect.error();
  return DialectImport(*dialect, from, to).run(progress);
}

Result<std::optional<TapeTime>> import_shipped(std::string_view name, Evidence& from, ImportTape& to,
                                               const ConvertProgress& progress) {
  const Result<Dialect>& dialect = shipped(name);
  if (!dialect) return dialect.error();
  return DialectImport(*dialect, from, to).run(progress);
}

int detect_shipped(std::string_view name, std::string_view head) {
  constexpr int kLookedAt = 400;
  const Result<Dialect>& dialect = shipped(name);
  if (!dialect || !dialect->is_detected() || head.find('\0') != std::string_view::npos) return 0;  // no text
  int found = 0;
  for (int i = 0; i < kLookedAt && !head.empty(); ++i) {
    const std::size_t end = std::min(head.find('\n'), head.size());
    const Dialect::Found line = dialect->find(without_colors(head.substr(0, end)));
    found += line.what == Dialect::Found::What::bytes ? 1 : 0;
    head.remove_prefix(std::min(end + 1, head.size()));
  }
  return found == 0 ? 0 : found == 1 ? 40 : 60;
}

}  // namespace porttape
