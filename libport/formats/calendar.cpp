#include "libport/formats/calendar.hpp"

#include <chrono>

namespace porttape {

std::optional<std::int64_t> calendar_us(unsigned year, unsigned month, unsigned day, std::int64_t us_of_day) {
  constexpr unsigned kFirstYear = 1970;
  constexpr unsigned kLastYear = 9999;
  constexpr std::int64_t kUsOfDay = 86'400'000'000;
  if (year < kFirstYear || year > kLastYear) return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(static_cast<int>(year)), std::chrono::month(month),
                                         std::chrono::day(day)};
  if (!date.ok()) return std::nullopt;
  return std::chrono::sys_days(date).time_since_epoch().count() * kUsOfDay + us_of_day;
}

}  // namespace porttape
