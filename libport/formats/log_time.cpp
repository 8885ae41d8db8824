#include "libport/formats/log_time.hpp"

#include <algorithm>

#include "libport/base/whole_number.hpp"
#include "libport/formats/calendar.hpp"

namespace porttape {

const std::string_view kLogTimePattern =
    R"((?P<time>(?:\d{4}[-/]\d\d[-/]\d\d[ T]|[A-Z][a-z]{2} [ \d]\d )?\d\d:\d\d:\d\d(?:[.,]\d{1,9})?(?:Z|[+-]\d\d:?\d\d)?|\d{1,12}\.\d{1,9}))";

namespace {

constexpr std::int64_t kUsOfLogSecond = 1'000'000;
constexpr std::int64_t kUsOfLogDay = 86'400 * kUsOfLogSecond;
constexpr std::int64_t kEpochFrom = 100'000'000 * kUsOfLogSecond;  // 1973
constexpr unsigned kSomeLeapYear = 2000;
constexpr std::int64_t kUsOfLogYear = 366 * kUsOfLogDay;

std::optional<unsigned> digits_at(std::string_view text, std::size_t at, std::size_t count) {
  return text.size() < at + count ? std::nullopt : whole_number<unsigned>(text.substr(at, count));
}

// ".130" or ",130" in microseconds; takes it off.
std::int64_t take_log_fraction(std::string_view& text) {
  if (!text.starts_with('.') && !text.starts_with(',')) return 0;
  text.remove_prefix(1);
  std::int64_t us = 0;
  int digits = 0;
  for (; !text.empty() && text.front() >= '0' && text.front() <= '9'; text.remove_prefix(1), ++digits)
    us = digits < 6 ? us * 10 + (text.front() - '0') : us;
  for (; digits < 6; ++digits) us *= 10;
  return us;
}

std::optional<std::int64_t> take_time_of_day(std::string_view& text) {
  const auto hour = digits_at(text, 0, 2);
  const auto minute = digits_at(text, 3, 2);
  const auto second = digits_at(text, 6, 2);
  if (!hour || !minute || !second || text[2] != ':' || text[5] != ':') return std::nullopt;
  if (*hour > 23 || *minute > 59 || *second > 60) return std::nullopt;
  text.remove_prefix(8);
  return ((*hour * 60 + *minute) * 60 + *second) * kUsOfLogSecond + take_log_fraction(text);
}

// "Z", "+02:00", "-0700": how far ahead of UTC.
std::optional<std::int64_t> zone_of(std::string_view text) {
  if (text == "Z") return 0;
  if (text.size() < 5 || (text[0] != '+' && text[0] != '-')) return std::nullopt;
  const auto hours = digits_at(text, 1, 2);
  const auto minutes = digits_at(text, text.size() - 2, 2);
  if (!hours || !minutes) return std::nullopt;
  const std::int64_t us = (*hours * 60 + *minutes) * 60 * kUsOfLogSecond;
  return text[0] == '-' ? -us : us;
}

std::optional<LogTime> time_of_number(std::string_view text, LogUnit unit) {
  const std::size_t dot = std::min(text.find('.'), text.size());
  const auto whole = whole_number<std::int64_t>(text.substr(0, dot));
  if (!whole || *whole < 0 || dot > (unit == LogUnit::seconds ? 12U : 15U)) return std::nullopt;
  std::string_view left = text.substr(dot);
  std::int64_t us = *whole;
  if (unit == LogUnit::seconds) us = us * kUsOfLogSecond + take_log_fraction(left);
  if (unit == LogUnit::millis) us = us * 1000 + take_log_fraction(left) / 1000;
  return LogTime{us >= kEpochFrom ? LogTime::Kind::epoch : LogTime::Kind::since, us, true};
}

unsigned month_of(std::string_view name) {
  constexpr std::string_view kMonths = "JanFebMarAprMayJunJulAugSepOctNovDec";
  const std::size_t at = kMonths.find(name);
  return at == std::string_view::npos || at % 3 != 0 ? 0 : static_cast<unsigned>(at / 3) + 1;
}

}  // namespace

std::optional<LogTime> parse_log_time(std::string_view text, LogUnit unit) {
  if (text.find(':') == std::string_view::npos) return time_of_number(text, unit);
  if (text.size() > 10 && (text[4] == '-' || text[4] == '/')) {
    const auto year = digits_at(text, 0, 4);
    const auto month = digits_at(text, 5, 2);
    const auto day = digits_at(text, 8, 2);
    std::string_view left = text.substr(11);
    const auto us = take_time_of_day(left);
    const auto at = year && month && day && us ? calendar_us(*year, *month, *day, *us) : std::nullopt;
    if (!at) return std::nullopt;
    const auto zone = zone_of(left);
    return LogTime{LogTime::Kind::epoch, *at - zone.value_or(0), zone.has_value()};
  }
  if (text.size() > 7 && text[3] == ' ') {
    const unsigned month = month_of(text.substr(0, 3));
    const auto day = text[4] == ' ' ? digits_at(text, 5, 1) : digits_at(text, 4, 2);
    std::string_view left = text.substr(7);
    const auto us = take_time_of_day(left);
    const auto at = day && us ? calendar_us(kSomeLeapYear, month, *day, *us) : std::nullopt;
    if (!at) return std::nullopt;
    return LogTime{LogTime::Kind::year, *at - *calendar_us(kSomeLeapYear, 1, 1, 0), false};
  }
  const auto us = take_time_of_day(text);
  if (!us) return std::nullopt;
  return LogTime{LogTime::Kind::day, *us, false};
}

std::optional<std::int64_t> LogClock::since_first(const LogTime& time) {
  if (!first_) first_ = time;
  if (first_->kind != time.kind) return std::nullopt;
  std::int64_t us = time.us - first_->us + passed_us_;
  const std::int64_t round = time.kind == LogTime::Kind::day    ? kUsOfLogDay
                             : time.kind == LogTime::Kind::year ? kUsOfLogYear
                                                                : 0;
  if (round > 0 && us < last_us_ - round / 2) {
    passed_us_ += round;
    us += round;
  }
  last_us_ = us;
  return us;
}

}  // namespace porttape
