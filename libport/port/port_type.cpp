#include "libport/port/port_type.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <string>

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

Error bad_value(const OptionSpec& option, std::string_view value, std::string_view accepted) {
  return make_error(
      Errc::usage, fmt::format("option '{}': '{}' is not valid; accepted: {}", option.name, value, accepted));
}

Result<std::string> check_flag(const OptionSpec& option, std::string_view value) {
  constexpr std::array<std::string_view, 4> on = {"1", "on", "yes", "true"};
  constexpr std::array<std::string_view, 4> off = {"0", "off", "no", "false"};
  if (std::ranges::find(on, value) != on.end()) return std::string("1");
  if (std::ranges::find(off, value) != off.end()) return std::string();
  return bad_value(option, value, "on, off");
}

Result<std::string> check_number(const OptionSpec& option, std::string_view value) {
  double number = 0;
  const auto [end, error] =
      std::from_chars(value.data(), value.data() + value.size(), number, std::chars_format::fixed);
  const bool whole = option.kind != Kind::integer || std::floor(number) == number;
  if (error != std::errc{} || end != value.data() + value.size() || !std::isfinite(number) || !whole ||
      number < option.min || number > option.max) {
    return bad_value(option, value,
                     fmt::format("a {}number from {} to {}", option.kind == Kind::integer ? "whole " : "",
                                 option.min, option.max));
  }
  return std::string(value);
}

}  // namespace

const OptionSpec* PortType::find(std::string_view option) const {
  const auto it = std::ranges::find(options, option, &OptionSpec::name);
  return it == options.end() ? nullptr : &*it;
}

std::vector<OptionSpec> with_common(std::vector<OptionSpec> options) {
  const std::vector<OptionSpec> common = {
      {"debug", Kind::integer, "0", "verbosity of the port, 0 to 9", 0, 9},
      {"timeout", Kind::number, "-1", "seconds that a blocking read or write waits, -1 for ever", -1, 1e9},
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
      if (std::ranges::find(option.choices, value) == option.choices.end()) {
        return bad_value(option, value, fmt::format("{}", fmt::join(option.choices, ", ")));
      }
      break;
  }
  return std::string(value);
}

Result<OptionValues> check_values(std::span<const OptionSpec> options, OptionValues values,
                                  std::string_view of) {
  OptionValues checked;
  for (auto& [name, value] : values) {
    const auto option = std::ranges::find(options, name, &OptionSpec::name);
    if (option == options.end()) {
      return make_error(Errc::usage, fmt::format("unknown option '{}' ('{}'){}; accepted: {}", name, value,
                                                 of, names_of(options)));
    }
    Result<std::string> good = check_value(*option, value);
    if (!good) return good.error();
    if (option->kind != Kind::flag || !good->empty()) checked.emplace(name, std::move(*good));
  }
  return checked;
}

}  // namespace porttape
