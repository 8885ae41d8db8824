#include "libport/formats/strace_terminal.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

constexpr std::array<std::pair<std::string_view, LineSignal::Name>, 2> kDriven{
    std::pair{std::string_view("TIOCM_DTR"), LineSignal::Name::dtr},
    std::pair{std::string_view("TIOCM_RTS"), LineSignal::Name::rts}};

// The value of "key=" in "{key=A|B, …}".
std::optional<std::string_view> member_of(std::string_view argument, std::string_view key) {
  const std::size_t at = argument.find(key);
  if (at == std::string_view::npos) return std::nullopt;
  argument.remove_prefix(at + key.size());
  return argument.substr(0, argument.find_first_of(",}"));
}

// One of "A|B|C" is that word.
bool has_flag(std::string_view flags, std::string_view wanted) {
  for (;;) {
    const std::size_t bar = flags.find('|');
    if (flags.substr(0, bar) == wanted) return true;
    if (bar == std::string_view::npos) return false;
    flags.remove_prefix(bar + 1);
  }
}

std::optional<unsigned> baud_of(std::string_view argument, std::string_view cflag) {
  if (has_flag(cflag, "BOTHER")) {
    const auto speed = member_of(argument, "c_ospeed=");
    return speed ? whole_number<unsigned>(*speed) : std::nullopt;
  }
  for (std::string_view left = cflag;;) {
    const std::size_t bar = left.find('|');
    const std::string_view flag = left.substr(0, bar);
    if (flag.starts_with('B')) {
      if (const auto baud = whole_number<unsigned>(flag.substr(1))) return baud;
    }
    if (bar == std::string_view::npos) return std::nullopt;
    left.remove_prefix(bar + 1);
  }
}

Parity traced_parity(bool on, bool odd, bool sticks) {
  if (!on) return Parity::none;
  if (sticks) return odd ? Parity::mark : Parity::space;
  return odd ? Parity::odd : Parity::even;
}

// "{B115200 -opost -isig -icanon -echo ...}", of older straces; what is not told is not known.
std::optional<SeenSettings> settings_of_words(std::string_view argument) {
  SeenSettings seen;
  std::optional<bool> even;
  std::optional<bool> odd;
  std::optional<bool> ixon;
  std::optional<bool> ixoff;
  while (!argument.empty()) {
    const std::size_t end = std::min(argument.find_first_of("{ }"), argument.size());
    std::string_view word = argument.substr(0, end);
    argument.remove_prefix(std::min(end + 1, argument.size()));
    const bool on = !word.starts_with('-');
    if (!on) word.remove_prefix(1);
    if (word.starts_with('B')) seen.baud = whole_number<unsigned>(word.substr(1));
    if (word.size() == 3 && word.starts_with("cs") && word[2] >= '5' && word[2] <= '8')
      seen.data_bits = static_cast<unsigned>(word[2] - '0');
    if (word == "parenb") even = on;
    if (word == "parodd") odd = on;
    if (word == "cstopb") seen.stop_bits = on ? 2 : 1;
    if (word == "crtscts") seen.hw_flow = on;
    if (word == "ixon") ixon = on;
    if (word == "ixoff") ixoff = on;
  }
  if (!seen.baud) return std::nullopt;
  if (even) seen.parity = traced_parity(*even, odd.value_or(false), false);
  if (ixon && ixoff) seen.sw_flow = *ixon && *ixoff;
  return seen;
}

std::optional<SeenSettings> settings_of(std::string_view argument) {
  const auto cflag = member_of(argument, "c_cflag=");
  if (!cflag) return settings_of_words(argument);
  SeenSettings seen;
  seen.baud = baud_of(argument, *cflag);
  for (const auto& [name, bits] : {std::pair{"CS5", 5U}, {"CS6", 6U}, {"CS7", 7U}, {"CS8", 8U}}) {
    if (has_flag(*cflag, name)) seen.data_bits = bits;
  }
  seen.parity =
      traced_parity(has_flag(*cflag, "PARENB"), has_flag(*cflag, "PARODD"), has_flag(*cflag, "CMSPAR"));
  seen.stop_bits = has_flag(*cflag, "CSTOPB") ? 2 : 1;
  seen.hw_flow = has_flag(*cflag, "CRTSCTS");
  if (const auto iflag = member_of(argument, "c_iflag="))
    seen.sw_flow = has_flag(*iflag, "IXON") && has_flag(*iflag, "IXOFF");
  return seen;
}

std::optional<FlushQueue> queue_of(std::string_view argument) {
  if (argument == "TCIFLUSH") return FlushQueue::in;
  if (argument == "TCOFLUSH") return FlushQueue::out;
  if (argument == "TCIOFLUSH") return FlushQueue::both;
  return std::nullopt;
}

}  // namespace

StraceTerminal::Asked StraceTerminal::set(std::string_view request, std::string_view argument) {
  Asked asked;
  const auto seen = settings_of(argument);
  if (request.starts_with("TCSETSF")) asked.events.emplace_back(event::Flush{FlushQueue::in});
  if (!seen) asked.problem = "settings are made and not told in words that are known; left out";
  if (seen && !seen->baud)
    asked.problem = "settings are made and their speed is not told (strace -v tells it)";
  if (seen && seen != settings_)
    asked.events.emplace_back(event::Settings{Side::driver, *seen, SettingsOrder::exact});
  if (seen) settings_ = seen;
  return asked;
}

StraceTerminal::Asked StraceTerminal::asked(std::string_view request, std::string_view argument) {
  // Some numbers have two names: "SNDCTL_TMR_START or TCSETS".
  if (const std::size_t or_at = request.rfind(" or "); or_at != std::string_view::npos)
    request.remove_prefix(or_at + 4);
  if (request.starts_with("TCSETS")) return set(request, argument);
  Asked asked;
  std::vector<Event>& events = asked.events;
  if (request == "TCFLSH") {
    if (const auto queue = queue_of(argument)) events.emplace_back(event::Flush{queue});
  } else if (request == "TIOCSBRK" || request == "TIOCCBRK") {
    events.emplace_back(event::Break{request == "TIOCSBRK", Side::driver});
  } else if (request == "TIOCMSET" || request == "TIOCMBIS" || request == "TIOCMBIC") {
    for (const auto& [word, name] : kDriven) {
      const bool named = argument.find(word) != std::string_view::npos;
      if (named || request == "TIOCMSET")
        events.emplace_back(event::Modem{name, named && request != "TIOCMBIC", Side::driver});
    }
  }
  return asked;
}

}  // namespace porttape
