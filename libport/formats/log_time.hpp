#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace porttape {

// What a number in a log counts.
enum class LogUnit : std::uint8_t { seconds, millis, micros };

struct LogTime {
  enum class Kind : std::uint8_t { epoch, year, day, since };  // since 1970, New Year, midnight, some moment
  Kind kind = Kind::since;
  std::int64_t us = 0;
  bool zoned = false;  // the text says which zone
};

// The expression that finds such times in a line, as dialects have it by the word TIME.
extern const std::string_view kLogTimePattern;

// "2022-07-21 15:23:02,130", "2021-04-05T10:12:13.123Z", "2026/11/23 22:42:42", "Jul 04 17:00:27",
// "10:12:13.5", "1795470615.33", "12.5".
std::optional<LogTime> parse_log_time(std::string_view text, LogUnit unit);

// Gives times of one log as microseconds since its first; midnight, or New Year, may pass between them.
class LogClock {
 public:
  // Nothing: this one is of another kind than the first.
  std::optional<std::int64_t> since_first(const LogTime& time);
  [[nodiscard]] const std::optional<LogTime>& first() const { return first_; }

 private:
  std::optional<LogTime> first_;
  std::int64_t last_us_ = 0;
  std::int64_t passed_us_ = 0;  // the days or years that are over
};

}  // namespace porttape
