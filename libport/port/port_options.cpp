#include "libport/port/port_options.hpp"

#include <charconv>
#include <fmt/format.h>
#include <utility>
#include <vector>

#include "libport/port/option_schema.hpp"

namespace porttape {
namespace {

constexpr std::string_view kSeparators = ", \t\n";  // of flexiport's option strings

Error usage(std::string message) { return make_error(Errc::usage, std::move(message)); }

std::string type_names() {
  std::string names;
  for (const PortType& type : port_types()) {
    if (!names.empty()) names += ", ";
    names += type.name;
  }
  return names;
}

std::string option_names(const PortType& type) {
  std::string names;
  for (const OptionSpec& option : type.options) {
    if (!names.empty()) names += ", ";
    names += option.name;
  }
  return names;
}

std::vector<std::string_view> split(std::string_view text, std::string_view separators) {
  std::vector<std::string_view> tokens;
  while (!text.empty()) {
    const std::size_t end = text.find_first_of(separators);
    if (end != 0) tokens.push_back(text.substr(0, end));
    if (end == std::string_view::npos) break;
    text.remove_prefix(end + 1);
  }
  return tokens;
}

// `key=value` or a bare key, which turns a boolean option on.
std::pair<std::string, std::string> split_option(std::string_view token) {
  const std::size_t equals = token.find('=');
  if (equals == std::string_view::npos) return {std::string(token), "1"};
  return {std::string(token.substr(0, equals)), std::string(token.substr(equals + 1))};
}

bool is_option_string(std::string_view spec) {
  for (const std::string_view token : split(spec, kSeparators)) {
    if (token.starts_with("type=")) return true;
  }
  return false;
}

Result<PortOptions> parse_option_string(std::string_view spec) {
  PortOptions options;
  for (const std::string_view token : split(spec, kSeparators)) {
    auto [key, value] = split_option(token);
    if (key == "type") {
      options.type = std::move(value);
    } else {
      options.values[std::move(key)] = std::move(value);
    }
  }
  return options;
}

Result<PortOptions> parse_short(std::string_view spec) {
  PortOptions options;
  std::string_view rest = spec;
  if (spec.starts_with("/dev/")) {
    options.type = "serial";
  } else {
    const std::size_t end = spec.find_first_of(":,");
    options.type = std::string(spec.substr(0, end));
    rest = end == std::string_view::npos ? std::string_view{} : spec.substr(spec[end] == ':' ? end + 1 : end);
  }
  const PortType* type = find_port_type(options.type);
  if (type == nullptr) return options;  // check_port() says so
  const std::size_t main_end = rest.find(',');
  if (const std::string_view main = rest.substr(0, main_end); !main.empty()) {
    options.values[std::string(type->main)] = std::string(main);
  }
  if (main_end == std::string_view::npos) return options;
  for (const std::string_view token : split(rest.substr(main_end), ",")) {
    auto [key, value] = split_option(token);
    options.values[std::move(key)] = std::move(value);
  }
  return options;
}

template <class T>
T parsed(const std::string& text) {
  T value{};
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

}  // namespace

std::string PortOptions::text(const std::string& option) const {
  if (const auto it = values.find(option); it != values.end()) return it->second;
  const PortType* known = find_port_type(type);
  const OptionSpec* spec = known == nullptr ? nullptr : known->find(option);
  return spec == nullptr ? std::string() : std::string(spec->default_value);
}

bool PortOptions::flag(const std::string& option) const { return has(option); }
long PortOptions::integer(const std::string& option) const { return static_cast<long>(number(option)); }
double PortOptions::number(const std::string& option) const { return parsed<double>(text(option)); }

std::string PortOptions::name() const {
  const PortType* known = find_port_type(type);
  const std::string main = known == nullptr ? std::string() : text(std::string(known->main));
  return main.empty() ? type : type + ":" + main;
}

Result<PortOptions> parse_port(std::string_view spec) {
  if (split(spec, kSeparators).empty()) {
    return usage(fmt::format("a port is missing; name one as TYPE:MAIN[,option=value…] with a type of {}",
                             type_names()));
  }
  Result<PortOptions> options = is_option_string(spec) ? parse_option_string(spec) : parse_short(spec);
  if (!options) return options;
  Result<PortOptions> checked = check_port(std::move(*options));
  if (!checked) return usage(fmt::format("port '{}': {}", spec, checked.error().message));
  return checked;
}

Result<PortOptions> check_port(PortOptions options) {
  if (options.type.empty()) return usage("option 'type' is missing; accepted: " + type_names());
  const PortType* type = find_port_type(options.type);
  if (type == nullptr)
    return usage(fmt::format("unknown type '{}'; accepted: {}", options.type, type_names()));
  for (auto it = options.values.begin(); it != options.values.end();) {
    const OptionSpec* spec = type->find(it->first);
    if (spec == nullptr) {
      return usage(fmt::format("unknown option '{}' ('{}') of type {}; accepted: {}", it->first, it->second,
                               type->name, option_names(*type)));
    }
    Result<std::string> value = check_value(*spec, it->second);
    if (!value) return value.error();
    if (spec->kind == OptionSpec::Kind::flag && value->empty()) {
      it = options.values.erase(it);
    } else {
      (it++)->second = std::move(*value);
    }
  }
  return options;
}

std::string port_help() {
  std::string out =
      "A PORT is TYPE:MAIN[,option=value…] or type=TYPE,option=value…; a bare /dev/… is serial:.\n";
  for (const PortType& type : port_types()) {
    out += fmt::format("\n{}:{}  {}\n", type.name, type.main, type.help);
    for (const OptionSpec& option : type.options) {
      const std::string fallback =
          option.default_value.empty() ? "" : fmt::format(" [{}]", option.default_value);
      out += fmt::format("  {:<12} {}{}\n", option.name, option.help, fallback);
    }
  }
  return out;
}

}  // namespace porttape
