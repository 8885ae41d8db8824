#pragma once

#include <limits>
#include <span>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"

namespace porttape {

// One option of a port type: how its value is checked and what --help says of it.
struct OptionSpec {
  enum class Kind { text, flag, integer, number, choice };

  std::string_view name;
  Kind kind = Kind::text;
  std::string_view default_value = {};
  std::string_view help = {};
  double min = 0;  // integer and number
  double max = std::numeric_limits<double>::max();
  std::vector<std::string_view> choices = {};
};

// The options that the main part of a short spelling sets: `MAIN`, or `MAIN:PORT` where there is a port.
struct ShortForm {
  std::string_view main;
  std::string_view port = {};
};

// A port type. `listening` is the short form behind `NAME-listen:`, which also sets the option `listen`; its
// `main` is empty where the type has none.
struct PortType {
  std::string_view name;
  ShortForm form;
  std::vector<OptionSpec> options;
  std::string_view help;
  ShortForm listening = {};

  [[nodiscard]] const OptionSpec* find(std::string_view option) const;
};

// Every type that has ports, the recording ones (`seriallog`) included. Nothing for an unknown name.
std::span<const PortType> port_types();
const PortType* find_port_type(std::string_view name);

// Checks a value and gives its canonical form ("1" and "" for flags). The error names option, value and what
// is accepted.
Result<std::string> check_value(const OptionSpec& option, std::string_view value);

}  // namespace porttape
