#include "libport/port/port_options.hpp"

#include <charconv>
#include <fmt/format.h>
#include <utility>

#include "libport/port/option_schema.hpp"
#include "libport/port/short_spelling.hpp"
#include "libport/port/socket_address.hpp"

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

bool is_option_string(std::string_view spec) {
  for (const std::string_view token : split_tokens(spec, kSeparators)) {
    if (token.starts_with("type=")) return true;
  }
  return false;
}

Result<PortOptions> parse_option_string(std::string_view spec) {
  PortOptions options;
  for (const std::string_view token : split_tokens(spec, kSeparators)) {
    auto [key, value] = split_option(token);
    if (key == "type") {
      options.type = std::move(value);
    } else {
      options.values[std::move(key)] = std::move(value);
    }
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

Result<PortOptions> parse_port(std::string_view spec) {
  if (split_tokens(spec, kSeparators).empty()) {
    return usage(fmt::format("a port is missing; name one as TYPE:MAIN[,option=value…] with a type of {}",
                             type_names()));
  }
  Result<PortOptions> options =
      is_option_string(spec) ? parse_option_string(spec) : parse_short_spelling(spec);
  if (!options) return options;
  Result<PortOptions> checked = check_port(std::move(*options));
  if (!checked) return usage(fmt::format("port '{}': {}", spec, checked.error().message));
  return checked;
}

namespace {

// Octal permissions, as chmod(1) takes them.
bool is_mode(std::string_view text) {
  return !text.empty() && text.size() <= 4 && (text.size() < 4 || text.front() == '0') &&
         text.find_first_not_of("01234567") == std::string_view::npos;
}

// What a value alone does not tell.
Result<void> check_together(const PortOptions& options) {
  const bool tcp = options.type == "tcp" || options.type == "tcplog";
  const bool path = options.type == "unix" || options.type == "unixlog";
  if (tcp && options.integer("port") == 0 && !options.flag("listen")) {
    return usage("option 'port': '0' is not valid; accepted: a whole number from 1 to 65535");
  }
  if (const auto file = options.values.find("file"); file != options.values.end() && file->second.empty())
    return usage("option 'file' is empty; accepted: the name of a tape");
  if (const auto mode = options.values.find("mode"); mode != options.values.end() && !is_mode(mode->second)) {
    return usage(
        fmt::format("option 'mode': '{}' is not valid; accepted: octal permissions like 0660", mode->second));
  }
  if (!path) return {};
  if (options.text("path").empty()) return usage("option 'path' is missing; accepted: the path of a socket");
  if (const Result<SocketAddress> address = unix_address(options.text("path")); !address)
    return address.error();
  return {};
}

}  // namespace

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
  if (Result<void> together = check_together(options); !together) return together.error();
  const bool udp = options.type == "udp" || options.type == "udplog";
  if (udp && options.flag("listen")) options.values.try_emplace("recv_ip", "127.0.0.1");
  return options;
}

std::string port_help() {
  const auto spelling = [](std::string_view name, const ShortForm& form) {
    return fmt::format("{}:{}{}{}", name, form.main, form.port.empty() ? "" : ":", form.port);
  };
  std::string out =
      "A PORT is TYPE:MAIN[,option=value…] or type=TYPE,option=value…; a bare /dev/… is serial:.\n";
  for (const PortType& type : port_types()) {
    out += fmt::format("\n{}  {}\n", spelling(type.name, type.form), type.help);
    if (!type.listening.main.empty())
      out += spelling(std::string(type.name) + std::string(kListenSuffix), type.listening) + "\n";
    for (const OptionSpec& option : type.options) {
      const std::string fallback =
          option.default_value.empty() ? "" : fmt::format(" [{}]", option.default_value);
      out += fmt::format("  {:<12} {}{}\n", option.name, option.help, fallback);
    }
  }
  return out;
}

}  // namespace porttape
