#include "libport/formats/strace_line.hpp"

#include <algorithm>
#include <charconv>

#include "libport/formats/byte_text.hpp"

namespace porttape {
namespace {

constexpr std::int64_t kDayUs = 24LL * 3600 * 1'000'000;
constexpr std::int64_t kYear2000Us = 946'684'800LL * 1'000'000;
constexpr std::string_view kUnfinished = " <unfinished ...>";
constexpr std::string_view kResumed = " resumed>";

bool is_digit(char c) { return c >= '0' && c <= '9'; }

template <class Number>
std::optional<Number> take_number(std::string_view& text) {
  Number number{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc()) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return number;
}

void skip_blanks(std::string_view& text) {
  while (text.starts_with(' ')) text.remove_prefix(1);
}

// "[pid 123] " or "123 " in front.
std::uint32_t take_thread(std::string_view& text) {
  std::string_view left = text;
  const bool bracket = left.starts_with("[pid");
  if (bracket) left.remove_prefix(4);
  skip_blanks(left);
  const auto thread = take_number<std::uint32_t>(left);
  if (!thread || !left.starts_with(bracket ? ']' : ' ')) return 0;
  if (bracket) left.remove_prefix(1);
  skip_blanks(left);
  text = left;
  return *thread;
}

// "12:34:56.789", in microseconds.
std::optional<std::int64_t> take_clock(std::string_view& text) {
  std::string_view left = text;
  std::int64_t seconds = 0;
  for (int part = 0; part < 2; ++part) {
    const auto number = take_number<unsigned>(left);
    if (!number || !left.starts_with(':')) return std::nullopt;
    left.remove_prefix(1);
    seconds = (seconds + *number) * 60;
  }
  const auto us = take_seconds_us(left);
  if (!us) return std::nullopt;
  text = left;
  return seconds * 1'000'000 + *us;
}

bool is_name(std::string_view text) {
  return !text.empty() &&
         std::ranges::all_of(text, [](char c) { return c == '_' || is_digit(c) || (c >= 'a' && c <= 'z'); });
}

// " <0.000123>" at the end: how long it took. Takes it off.
std::optional<std::int64_t> take_duration(std::string_view& text) {
  if (!text.ends_with('>')) return std::nullopt;
  const std::size_t open = text.rfind(" <");
  if (open == std::string_view::npos) return std::nullopt;
  std::string_view number = text.substr(open + 2);
  const auto us = take_seconds_us(number);
  if (!us || number != ">") return std::nullopt;
  text = text.substr(0, open);
  return us;
}

// Walks over arguments and tells which characters stand outside of strings; in these an escape is two.
template <class See>
void each_outside(std::string_view args, See&& see) {
  bool quoted = false;
  for (std::size_t i = 0; i < args.size(); ++i) {
    const char c = args[i];
    if (quoted && c == '\\') {
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
      see(i, c);
    } else if (!quoted) {
      if (!see(i, c)) return;
    }
  }
}

}  // namespace

void StraceLines::take_time(std::string_view& text) {
  skip_blanks(text);
  std::string_view left = text;
  const auto clock = take_clock(left);
  const auto seconds = clock ? std::nullopt : take_seconds_us(left);
  if ((!clock && !seconds) || !left.starts_with(' ')) {
    if (clock_ == Clock::none) ++now_us_;
    return;
  }
  if (clock) {
    clock_ = Clock::day;
    if (*clock + midnights_us_ < now_us_ - kDayUs / 2) midnights_us_ += kDayUs;
    now_us_ = *clock + midnights_us_;
  } else if (*seconds > kYear2000Us) {
    clock_ = Clock::date;
    now_us_ = *seconds;
  } else {
    clock_ = Clock::relative;
    now_us_ += *seconds;
  }
  skip_blanks(left);
  text = left;
}

StraceLines::Line StraceLines::read(std::string_view text) {
  const std::uint32_t thread = take_thread(text);
  take_time(text);
  if (text.starts_with("--- ")) return {.call = {}, .end = {}, .understood = true};
  if (text.starts_with("+++ ")) {
    unfinished_.erase(thread);
    const bool ended =
        text.find("exited") != std::string_view::npos || text.find("killed") != std::string_view::npos;
    return {.call = {}, .end = ended ? std::optional(StraceEnd{thread}) : std::nullopt, .understood = true};
  }
  return read_call(text, thread);
}

StraceLines::Line StraceLines::read_call(std::string_view text, std::uint32_t thread) {
  StraceCall call{.thread = thread,
                  .begin_us = now_us_,
                  .end_us = {},
                  .name = {},
                  .args = {},
                  .result = {},
                  .error = {},
                  .interrupted = false};
  if (text.starts_with("<... ")) {
    const std::size_t resumed = text.find(kResumed);
    const auto begun = unfinished_.find(thread);
    if (resumed == std::string_view::npos || begun == unfinished_.end())
      return {.call = {}, .end = {}, .understood = resumed != std::string_view::npos};
    call = std::move(begun->second);
    unfinished_.erase(begun);
    call.end_us = now_us_;
    call.interrupted = true;
    text.remove_prefix(resumed + kResumed.size());
  } else {
    const std::size_t paren = text.find('(');
    if (paren == std::string_view::npos || !is_name(text.substr(0, paren))) return {};
    call.name = text.substr(0, paren);
    text.remove_prefix(paren + 1);
  }
  if (text.ends_with(kUnfinished)) {
    call.args += text.substr(0, text.size() - kUnfinished.size());
    unfinished_.insert_or_assign(thread, std::move(call));
    return {.call = {}, .end = {}, .understood = true};
  }
  if (const auto took = take_duration(text))
    call.end_us = std::max(call.begin_us + *took, call.end_us.value_or(0));
  const std::size_t equals = text.rfind(" = ");
  const std::size_t close = equals == std::string_view::npos ? equals : text.substr(0, equals).rfind(')');
  if (close == std::string_view::npos) return {};
  call.args += text.substr(0, close);
  text.remove_prefix(equals + 3);
  call.result = take_number<std::int64_t>(text);
  skip_blanks(text);
  if (call.result == -1) call.error = text.substr(0, text.find(' '));
  return {.call = std::move(call), .end = {}, .understood = true};
}

std::vector<StraceString> strace_strings(std::string_view args) {
  std::vector<StraceString> strings;
  std::optional<std::size_t> begin;
  each_outside(args, [&](std::size_t at, char c) {
    if (c != '"') return true;
    if (!begin) {
      begin = at + 1;
      return true;
    }
    std::size_t wrong = 0;
    const auto bytes = unescaped_bytes(args.substr(*begin, at - *begin), wrong);
    strings.push_back({bytes.value_or(Bytes{}), !bytes || args.substr(at + 1).starts_with("...")});
    begin.reset();
    return true;
  });
  return strings;
}

std::optional<int> strace_number(std::string_view args) { return take_number<int>(args); }

std::string_view strace_argument(std::string_view args, std::size_t n) {
  int depth = 0;
  std::size_t begin = n == 0 ? 0 : std::string_view::npos;
  std::size_t end = args.size();
  each_outside(args, [&](std::size_t at, char c) {
    if (c == '(' || c == '[' || c == '{') ++depth;
    if (c == ')' || c == ']' || c == '}') --depth;
    if (c != ',' || depth > 0) return true;
    if (n == 0) {
      end = at;
      return false;
    }
    if (--n == 0) begin = at + 1;
    return true;
  });
  if (begin == std::string_view::npos) return {};
  std::string_view argument = args.substr(begin, end - begin);
  skip_blanks(argument);
  return argument;
}

}  // namespace porttape
