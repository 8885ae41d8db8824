#include "libport/formats/socat_format.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

#include "libport/base/whole_number.hpp"
#include "libport/formats/calendar.hpp"
#include "libport/formats/line_import.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostOfSocatBlock = std::size_t{64} << 20U;

// "> 2026/11/23 21:50:15.000324360  length=8 from=0 to=7"
struct SocatHead {
  Direction direction = Direction::read;
  std::int64_t us = 0;  // since 1970
  bool whole_seconds = false;
  std::size_t length = 0;
  std::uint64_t line = 0;
};

// A number and what ends it, off the text's front.
std::optional<unsigned> take_number(std::string_view& text, std::string_view end) {
  const std::size_t digits = std::min(text.find_first_not_of("0123456789"), text.size());
  const auto number = whole_number<unsigned>(text.substr(0, digits));
  if (!number || !text.substr(digits).starts_with(end)) return std::nullopt;
  text.remove_prefix(digits + end.size());
  return number;
}

// Microseconds, in 6 digits, in 9 (1.7.4 fills them up in front), or without zeros in front. A number of 9
// digits that is no such one is of nanoseconds.
std::optional<std::int64_t> take_socat_fraction(std::string_view& text) {
  constexpr std::int64_t kUsOfSecond = 1'000'000;
  constexpr std::size_t kMostDigits = 9;
  text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
  const std::size_t digits = std::min(text.find_first_not_of("0123456789"), text.size());
  const auto number = whole_number<std::int64_t>(text.substr(0, digits));
  if (!number || digits > kMostDigits) return std::nullopt;
  text.remove_prefix(digits);
  return *number < kUsOfSecond ? *number : *number / 1000;
}

// "2026/11/23 21:50:15.000324360"
bool take_socat_time(std::string_view& text, SocatHead& head) {
  const auto year = take_number(text, "/");
  const auto month = year ? take_number(text, "/") : std::nullopt;
  const auto day = month ? take_number(text, " ") : std::nullopt;
  const auto hour = day ? take_number(text, ":") : std::nullopt;
  const auto minute = hour ? take_number(text, ":") : std::nullopt;
  const auto second = minute ? take_number(text, "") : std::nullopt;
  if (!second || *hour > 23 || *minute > 59 || *second > 60) return false;
  head.whole_seconds = !text.starts_with('.');
  std::optional<std::int64_t> fraction = 0;
  if (!head.whole_seconds) {
    text.remove_prefix(1);
    fraction = take_socat_fraction(text);
  }
  const std::int64_t seconds = (std::int64_t{*hour} * 60 + *minute) * 60 + *second;
  const auto us = calendar_us(*year, *month, *day, seconds * 1'000'000);
  if (!us || !fraction) return false;
  head.us = *us + *fraction;
  return true;
}

std::optional<SocatHead> socat_head(std::string_view text) {
  constexpr std::string_view kLength = "length=";
  if (!text.starts_with("> ") && !text.starts_with("< ")) return std::nullopt;
  SocatHead head;
  head.direction = text.front() == '>' ? Direction::write : Direction::read;
  text.remove_prefix(2);
  if (!take_socat_time(text, head)) return std::nullopt;
  text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
  if (!text.starts_with(kLength)) return std::nullopt;
  text.remove_prefix(kLength.size());
  const auto size = take_number(text, "");
  if (!size || *size > kMostOfSocatBlock) return std::nullopt;
  head.length = *size;
  return head;
}

// " 50 49 4e", up to the column of text.
Bytes bytes_of_row(std::string_view text, std::size_t most) {
  Bytes bytes;
  while (bytes.size() < most && text.size() >= 3 && text.front() == ' ') {
    const auto byte = bytes_of_hex(text.substr(1, 2));
    if (!byte || byte->size() != 1) break;
    append(bytes, *byte);
    text.remove_prefix(3);
  }
  return bytes;
}

class SocatImport final : public LineImport {
 public:
  SocatImport(Evidence& from, ImportTape& to) : LineImport(from, to) { to.keep_order(); }

 private:
  enum class Style : std::uint8_t { unknown, hex, text };

  Result<void> take_line() override {
    const std::string_view text = line().text;
    if (!head_) return begin(text);
    if (style_ == Style::unknown)
      style_ = bytes_of_row(text, head_->length).empty() ? Style::text : Style::hex;
    return style_ == Style::hex ? take_hex(text) : take_text(text);
  }

  Result<void> at_end() override {
    if (Result<void> put = put_data(); !put) return put;
    if (!first_us_)
      return make_error(Errc::not_a_tape, evidence().name() + ": no block of socat -x or -v is in it");
    if (whole_seconds_) tape().guessed("its times are whole seconds");
    if (dots_ > 0)
      tape().guessed(fmt::format(
          "{} dots are dots; socat -v writes one for every byte that it does not show (-x shows all)",
          dots_));
    end_at(tape().latest());
    return {};
  }

  Result<void> begin(std::string_view text) {
    if (text == "--" || text.empty()) return {};
    head_ = socat_head(text);
    if (!head_) {
      tape().problem_of_line(line().number, "no block of socat; left out");
      return {};
    }
    head_->line = line().number;
    whole_seconds_ |= head_->whole_seconds;
    if (!first_us_) {
      first_us_ = head_->us;
      tape().wall_of_zero(wall_text(Micros(head_->us)));
      tape().guessed("its times are UTC");
    }
    return head_->length == 0 ? put_data() : Result<void>();
  }

  Result<void> take_hex(std::string_view text) {
    const Bytes bytes = bytes_of_row(text, head_->length - data_.size());
    append(data_, bytes);
    if (!bytes.empty()) return data_.size() == head_->length ? put_data() : Result<void>();
    // It was broken off: what came is kept, and what is missing told.
    if (Result<void> put = put_data(); !put) return put;
    return begin(text);
  }

  Result<void> take_text(std::string_view text) {
    constexpr std::string_view kEscapes = "nrtabfv\\0e";
    constexpr std::string_view kEscaped("\n\r\t\a\b\f\v\\\0\x1b", 10);
    while (!text.empty() && data_.size() < head_->length) {
      char c = text.front();
      text.remove_prefix(1);
      dots_ += c == '.' ? 1U : 0U;
      const std::size_t escape =
          c == '\\' && !text.empty() ? kEscapes.find(text.front()) : std::string_view::npos;
      if (escape != std::string_view::npos) {
        c = kEscaped[escape];
        text.remove_prefix(1);
      }
      data_.push_back(static_cast<Byte>(c));
    }
    if (data_.size() < head_->length && line().whole) data_.push_back('\n');
    if (data_.size() < head_->length) return {};
    if (Result<void> put = put_data(); !put) return put;
    return begin(text);  // behind a block without a newline the next one stands on its line
  }

  Result<void> put_data() {
    if (!head_) return {};
    const SocatHead head = *std::exchange(head_, std::nullopt);
    const Bytes data = std::exchange(data_, {});
    const TapeTime at = tape_time_us(head.us - *first_us_);
    tape().at_line(head.line);
    if (!data.empty()) {
      if (Result<void> put = tape().block(head.direction, at, data); !put) return put;
    }
    if (data.size() == head.length) return {};
    const std::size_t missing = head.length - data.size();
    tape().problem_of_line(line().number, "a block ends early");
    return tape().event(at, event::Gap{missing, std::nullopt, "not in socat's log"});
  }

  std::optional<SocatHead> head_;  // of the block whose bytes follow
  Bytes data_;
  Style style_ = Style::unknown;
  std::uint64_t dots_ = 0;
  std::optional<std::int64_t> first_us_;
  bool whole_seconds_ = false;
};

}  // namespace

Result<std::optional<TapeTime>> import_socat(Evidence& from, ImportTape& to,
                                             const ConvertProgress& progress) {
  return SocatImport(from, to).run(progress);
}

int detect_socat(std::string_view head) {
  constexpr int kLinesLookedAt = 20;
  for (int lines = 0; lines < kLinesLookedAt && !head.empty(); ++lines) {
    const std::size_t end = head.find('\n');
    if (socat_head(head.substr(0, end))) return 95;
    if (end == std::string_view::npos) break;
    head.remove_prefix(end + 1);
  }
  return 0;
}

}  // namespace porttape
