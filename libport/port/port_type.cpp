#include "libport/port/port_type.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <string>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

template <class Named>
std::string names_of(const Named& all) {
  std::string names;
  for (const auto& each : all) {
    if (!names.empty()) names += ", ";
    names += each.name;
  }
  return names;
}

struct Unit {
  std::string_view name;
  std::string_view words;
  double seconds;
};
constexpr std::array kUnits = {Unit{"us", "microseconds", 1e-6}, Unit{"ms", "milliseconds", 1e-3},
                               Unit{"s", "seconds", 1}, Unit{"min", "minutes", 60}};

const Unit* find_unit(std::string_view name) {
  if (name == "µs") name = "us";
  if (name == "sec") name = "s";
  const auto* const unit = std::ranges::find(kUnits, name, &Unit::name);
  return unit == kUnits.end() ? nullptr : unit;
}

// Without an exponent, and without zeros at the end.
std::string number_text(double number) {
  std::string text = fmt::format("{:.6f}", number);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return text;
}

// `0 to 9`; from the limit on `0 or more`.
std::string range_of(const OptionSpec& option, double no_limit) {
  return option.max >= no_limit ? number_text(option.min) + " or more"
                                : number_text(option.min) + " to " + number_text(option.max);
}

// So few that each is told.
bool lists_numbers(const OptionSpec& option) {
  return option.kind == Kind::integer && option.max - option.min < 4;
}

bool is_number(const OptionSpec& option) {
  return option.kind == Kind::integer || option.kind == Kind::number;
}

// `500ms` where the option takes milliseconds: the number to write instead.
std::string without_unit(const OptionSpec& option, std::string_view value) {
  double number = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  const auto digits = static_cast<std::size_t>(end - value.data());
  const Unit* const wanted = find_unit(option.unit);
  const Unit* const given = find_unit(value.substr(digits));
  if (error != std::errc{} || wanted == nullptr || given == nullptr) return {};
  const std::string meant = number_text(number * given->seconds / wanted->seconds);
  return check_value(option, meant) ? fmt::format("; did you mean '{}'?", meant) : std::string();
}

// Without the number that may stand behind it.
std::string_view word_of(std::string_view choice) { return choice.substr(0, choice.find("[:")); }

bool is_choice(std::string_view choice, std::string_view value) {
  const std::string_view word = word_of(choice);
  if (value == word) return true;
  const bool numbered =
      word != choice && value.starts_with(word) && value.substr(word.size()).starts_with(':');
  return numbered && whole_number<std::uint32_t>(value.substr(word.size() + 1));
}

std::string nearest_choice(const OptionSpec& option, std::string_view value) {
  std::vector<std::string_view> words;
  for (const std::string_view choice : option.choices) words.push_back(word_of(choice));
  return did_you_mean(value, words);
}

Error bad_value(const OptionSpec& option, std::string_view value) {
  const std::string guess = is_number(option) ? without_unit(option, value) : nearest_choice(option, value);
  return make_error(Errc::usage, fmt::format("option '{}': {} is not valid; accepted: {}{}", option.name,
                                             in_quotes(value), accepted_by(option), guess));
}

Result<std::string> check_flag(const OptionSpec& option, std::string_view value) {
  constexpr std::array<std::string_view, 4> on = {"1", "on", "yes", "true"};
  constexpr std::array<std::string_view, 4> off = {"0", "off", "no", "false"};
  if (std::ranges::find(on, value) != on.end()) return std::string("1");
  if (std::ranges::find(off, value) != off.end()) return std::string();
  return bad_value(option, value);
}

Result<std::string> check_number(const OptionSpec& option, std::string_view value) {
  double number = 0;
  const auto [end, error] =
      std::from_chars(value.data(), value.data() + value.size(), number, std::chars_format::fixed);
  const bool whole = option.kind != Kind::integer || std::floor(number) == number;
  if (error != std::errc{} || end != value.data() + value.size() || !std::isfinite(number) || !whole ||
      number < option.min || number > option.max) {
    return bad_value(option, value);
  }
  return std::string(value);
}

}  // namespace

std::string value_name(const OptionSpec& option) {
  if (!option.value_name.empty()) return std::string(option.value_name);
  if (option.kind == Kind::flag) return {};
  if (option.kind == Kind::choice) return fmt::format("{}", fmt::join(option.choices, "|"));
  if (option.unit == "ms") return "MS";
  if (option.unit == "us") return "US";
  if (option.unit == "s") return "SEC";
  if (!lists_numbers(option)) return is_number(option) ? "N" : "TEXT";
  std::string all;
  for (double number = option.min; number <= option.max; ++number)
    all += (all.empty() ? "" : "|") + number_text(number);
  return all;
}

std::string help_of(const OptionSpec& option) {
  std::string facts = is_number(option) && !lists_numbers(option) ? range_of(option, 1e9) : "";
  if (!option.default_value.empty())
    facts += fmt::format("{}default {}", facts.empty() ? "" : ", ", option.default_value);
  return facts.empty() ? std::string(option.help) : fmt::format("{} [{}]", option.help, facts);
}

std::string accepted_by(const OptionSpec& option) {
  switch (option.kind) {
    case Kind::text:
      return value_name(option);
    case Kind::flag:
      return "on, off";
    case Kind::choice:
      return fmt::format("{}", fmt::join(option.choices, ", "));
    case Kind::integer:
    case Kind::number:
      break;
  }
  const Unit* const unit = find_unit(option.unit);
  const std::string_view whole = option.kind == Kind::integer ? "whole " : "";
  if (unit != nullptr) return fmt::format("{}{}, {}", whole, unit->words, range_of(option, 1e15));
  return fmt::format("a {}number, {}", whole, range_of(option, 1e15));
}

Error unknown_option(std::string_view name, std::span<const OptionSpec> options, std::string_view of) {
  std::vector<std::string_view> names;
  for (const OptionSpec& option : options) names.push_back(option.name);
  std::string end = did_you_mean(name, names);
  if (end.empty()) end = fmt::format("; accepted: {}", fmt::join(names, ", "));
  return make_error(Errc::usage, fmt::format("unknown option {}{}{}", in_quotes(name), of, end));
}

const OptionSpec* PortType::find(std::string_view option) const {
  const auto it = std::ranges::find(options, option, &OptionSpec::name);
  return it == options.end() ? nullptr : &*it;
}

std::vector<OptionSpec> with_common(std::vector<OptionSpec> options) {
  const std::vector<OptionSpec> common = {
      {"debug", Kind::integer, "0", "verbosity of the port", 0, 9},
      {.name = "timeout",
       .kind = Kind::number,
       .default_value = "-1",
       .help = "how long a blocking read or write waits, -1: for ever",
       .min = -1,
       .max = 1e9,
       .unit = "s"},
      {"readonly", Kind::flag, "", "bytes come from the peer, none go to it"},
      {"writeonly", Kind::flag, "", "bytes go to the peer, none come from it"},
      {"readwrite", Kind::flag, "", "both ways (the default)"},
      {"alwaysopen", Kind::flag, "", "stays open while no driver has the other end open"},
  };
  options.insert(options.end(), common.begin(), common.end());
  return options;
}

const PortType* PortTypes::find(std::string_view name) const {
  const auto it = std::ranges::find(types_, name, &PortType::name);
  return it == types_.end() ? nullptr : &*it;
}

std::string PortTypes::names() const { return names_of(types_); }

std::vector<std::string> PortTypes::spellings() const {
  std::vector<std::string> all;
  for (const PortType& type : types_) {
    all.emplace_back(type.name);
    if (!type.listening.main.empty()) all.push_back(std::string(type.name) + std::string(kListenSuffix));
  }
  return all;
}

Result<std::string> check_value(const OptionSpec& option, std::string_view value) {
  switch (option.kind) {
    case Kind::text:
      break;
    case Kind::flag:
      return check_flag(option, value);
    case Kind::integer:
    case Kind::number:
      return check_number(option, value);
    case Kind::choice:
      if (std::ranges::none_of(option.choices, [value](auto choice) { return is_choice(choice, value); }))
        return bad_value(option, value);
      break;
  }
  return std::string(value);
}

Result<OptionValues> check_values(std::span<const OptionSpec> options, OptionValues values,
                                  std::string_view of) {
  OptionValues checked;
  for (auto& [name, value] : values) {
    const auto option = std::ranges::find(options, name, &OptionSpec::name);
    if (option == options.end()) return unknown_option(name, options, of);
    Result<std::string> good = check_value(*option, value);
    if (!good) return good.error();
    if (option->kind != Kind::flag || !good->empty()) checked.emplace(name, std::move(*good));
  }
  return checked;
}

}  // namespace porttape
