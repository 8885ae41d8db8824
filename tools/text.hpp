#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "libport/replay/report_words.hpp"
#include "libport/tape/event.hpp"

namespace porttape {

// "12.000345": microseconds as seconds, exact.
std::string seconds_number(std::int64_t us);

// Seconds from 0 on, of which 6 decimals count, as a user types them.
std::optional<TapeTime> parse_seconds(std::string_view text);

// "850 us", "98.8 ms", "12.3 s".
std::string span_text(std::int64_t us);

// "3.5 kB/s"; "-" where no time passed.
std::string rate_text(std::uint64_t bytes, std::int64_t us);

// "driver: 115200 baud, 1 stop bit, RTS/CTS (sampled)".
std::string settings_text(const event::Settings& settings);
// `driver: dtr off`; of a break, whose event says what it is: `driver: on`.
std::string signal_text(const TapedSignal& taped);
// The same, and `driver: break on`.
std::string named_signal_text(const TapedSignal& taped);

}  // namespace porttape
