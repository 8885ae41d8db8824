#include "libport/tape/tape_header.hpp"

#include <array>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <fcntl.h>
#include <optional>
#include <random>
#include <string_view>
#include <sys/random.h>
#include <unistd.h>

#include "libport/base/bytes.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/base/version.hpp"

namespace porttape {
namespace {

constexpr std::int64_t kMostApart = 10'000'000'000'000'000;  // µs; 300 years are nobody's

using WallMicros = std::chrono::sys_time<Micros>;

std::string rfc3339(WallMicros time) {
  const auto second = std::chrono::floor<std::chrono::seconds>(time);
  const std::time_t whole = second.time_since_epoch().count();
  std::tm utc{};
  ::gmtime_r(&whole, &utc);
  std::array<char, 32> date{};
  std::strftime(date.data(), date.size(), "%FT%T", &utc);
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%s.%06dZ", date.data(), static_cast<int>((time - second).count()));
  return text.data();
}

// Digits of `text` at `at`; nothing where there are others.
std::optional<int> digits(std::string_view text, std::size_t at, std::size_t count) {
  if (text.size() < at + count) return std::nullopt;
  int number = 0;
  const char* const end = text.data() + at + count;
  const auto [stop, error] = std::from_chars(text.data() + at, end, number);
  return error == std::errc{} && stop == end && text[at] != '-' ? std::optional(number) : std::nullopt;
}

// `±hh:mm` or `Z`.
std::optional<std::chrono::minutes> zone(std::string_view text) {
  if (text == "Z" || text == "z") return std::chrono::minutes{0};
  const auto hours = digits(text, 1, 2);
  const auto minutes = digits(text, 4, 2);
  const bool shaped = text.size() == 6 && text[3] == ':' && (text[0] == '+' || text[0] == '-');
  if (!shaped || !hours || !minutes) return std::nullopt;
  const auto ahead = std::chrono::hours(*hours) + std::chrono::minutes(*minutes);
  return text[0] == '-' ? -ahead : std::chrono::minutes(ahead);
}

// RFC 3339, to the microsecond.
std::optional<WallMicros> wall_time(std::string_view text) {
  namespace chrono = std::chrono;
  const auto year = digits(text, 0, 4);
  const auto month = digits(text, 5, 2);
  const auto day = digits(text, 8, 2);
  const auto hour = digits(text, 11, 2);
  const auto minute = digits(text, 14, 2);
  const auto second = digits(text, 17, 2);
  if (!year || !month || !day || !hour || !minute || !second) return std::nullopt;
  const chrono::year_month_day date{chrono::year(*year), chrono::month(static_cast<unsigned>(*month)),
                                    chrono::day(static_cast<unsigned>(*day))};
  const bool shaped = text[4] == '-' && text[7] == '-' && text[13] == ':' && text[16] == ':';
  if (!shaped || !date.ok() || *hour > 23 || *minute > 59 || *second > 60) return std::nullopt;
  std::size_t at = 19;
  Micros fraction{};
  if (text.size() > at && text[at] == '.') {
    int unit = 100'000;
    for (++at; at < text.size() && text[at] >= '0' && text[at] <= '9'; ++at, unit /= 10)
      fraction += Micros((text[at] - '0') * unit);
  }
  const auto ahead = zone(text.substr(at));
  if (!ahead) return std::nullopt;
  return WallMicros(chrono::sys_days(date)) + chrono::hours(*hour) + chrono::minutes(*minute) +
         chrono::seconds(*second) + fraction - *ahead;
}

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

std::string boot_id() {
  const UniqueFd file(::open("/proc/sys/kernel/random/boot_id", O_RDONLY | O_CLOEXEC));
  if (!file) return {};
  std::array<char, 64> text{};
  const ssize_t size = ::read(file.get(), text.data(), text.size());
  std::string id(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  return id.substr(0, id.find('\n'));
}

std::string random_id() {
  std::array<Byte, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), GRND_NONBLOCK) != static_cast<ssize_t>(bytes.size())) {
    std::random_device device;
    for (Byte& byte : bytes) byte = static_cast<Byte>(device());
  }
  return to_hex(bytes);
}

}  // namespace

std::string wall_text(Instant at, const Clock& clock) {
  return rfc3339(std::chrono::floor<Micros>(clock.wall()) -
                 std::chrono::duration_cast<Micros>(clock.now() - at));
}

std::string wall_text(Micros since_1970) { return rfc3339(WallMicros(since_1970)); }

TapeZero tape_zero(Instant zero, const Clock& clock) {
  const auto since_boot = std::chrono::duration_cast<Micros>(zero.time_since_epoch());
  return {wall_text(zero, clock), since_boot.count(), boot_id()};
}

std::optional<Micros> since(const TapeZero& first, const TapeZero& zero) {
  std::int64_t apart = 0;
  if (!first.boot.empty() && first.boot == zero.boot) {
    if (__builtin_sub_overflow(zero.monotonic_us, first.monotonic_us, &apart)) return std::nullopt;
  } else {
    const auto from = wall_time(first.wall.raw());
    const auto to = wall_time(zero.wall.raw());
    if (!from || !to) return std::nullopt;
    apart = (*to - *from).count();
  }
  return apart <= kMostApart && apart >= -kMostApart ? std::optional(Micros(apart)) : std::nullopt;
}

TapeZero later(TapeZero zero, Micros by) {
  if (const auto wall = wall_time(zero.wall.raw())) zero.wall = rfc3339(*wall + by);
  if (__builtin_add_overflow(zero.monotonic_us, by.count(), &zero.monotonic_us)) zero.monotonic_us = 0;
  return zero;
}

TapeHeader completed(TapeHeader header) {
  if (header.created.empty()) header.created = rfc3339(std::chrono::floor<Micros>(machine_clock().wall()));
  if (header.host.empty()) header.host = host_name();
  if (header.tool.empty()) header.tool = "porttape " + std::string(version());
  if (header.id.empty()) header.id = random_id();
  return header;
}

}  // namespace porttape
