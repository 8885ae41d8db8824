#include "libport/port/port_options.hpp"

#include <charconv>
#include <chrono>
#include <fmt/format.h>
#include <utility>

#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

Error usage(std::string message) { return make_error(Errc::usage, std::move(message)); }

Error in_port(std::string_view spec, const Error& error) {
  return make_error(error.code, fmt::format("port '{}': {}", spec, error.message));
}

CommonOptions common_options_of(const PortOptions& written) {
  CommonOptions common{.reads = !written.flag("writeonly"),
                       .writes = !written.flag("readonly"),
                       .always_open = written.flag("alwaysopen")};
  if (const double timeout = written.number("timeout"); timeout >= 0)
    common.timeout = std::chrono::duration_cast<Nanos>(std::chrono::duration<double>(timeout));
  return common;
}

}  // namespace

std::string PortOptions::text(const std::string& option) const {
  if (const auto it = values.find(option); it != values.end()) return it->second;
  const OptionSpec* spec = type == nullptr ? nullptr : type->find(option);
  return spec == nullptr ? std::string() : std::string(spec->default_value);
}

std::string PortOptions::name() const { return short_name(*this); }
std::string PortOptions::spelled() const { return short_spelling(*this); }

double PortOptions::number(const std::string& option) const {
  const std::string value = text(option);
  double number = 0;
  std::from_chars(value.data(), value.data() + value.size(), number);
  return number;
}

Result<unsigned> PortOptions::mode(const std::string& option) const {
  const std::string value = text(option);
  unsigned mode = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), mode, 8);
  const bool octal = error == std::errc{} && end == value.data() + value.size();
  if (!octal || value.size() > 4 || mode > 0777) {
    return usage(
        fmt::format("option '{}': '{}' is not valid; accepted: octal permissions like 0660", option, value));
  }
  return mode;
}

Result<PortOptions> parse_options(const PortTypes& types, std::string_view spec) {
  Result<OptionValues> values = read_spelling(types, spec);
  if (!values) return values.error();
  Result<PortOptions> checked = check_options(types, std::move(*values));
  if (!checked) return in_port(spec, checked.error());
  return checked;
}

Result<PortOptions> check_options(const PortTypes& types, OptionValues values) {
  const auto name = values.extract("type");
  if (!name || name.mapped().empty()) return usage("option 'type' is missing; accepted: " + types.names());
  const PortType* type = types.find(name.mapped());
  if (type == nullptr)
    return usage(fmt::format("unknown type '{}'; accepted: {}", name.mapped(), types.names()));
  return check_options(PortOptions{type, std::move(values)});
}

Result<PortOptions> check_options(PortOptions options) {
  Result<OptionValues> checked = check_values(options.type->options, std::move(options.values),
                                              fmt::format(" of type {}", options.type->name));
  if (!checked) return checked.error();
  options.values = std::move(*checked);
  if (options.type->complete) options.type->complete(options);
  return options;
}

Result<PortSpec> PortSpec::read(PortOptions written) {
  Result<TypedOptions> options = written.type->read(written);
  if (!options) return options.error();
  const CommonOptions common = common_options_of(written);
  return PortSpec(std::move(written), common, std::move(*options));
}

Result<PortSpec> parse_port(const PortTypes& types, std::string_view spec) {
  Result<PortOptions> written = parse_options(types, spec);
  if (!written) return written.error();
  Result<PortSpec> read = PortSpec::read(std::move(*written));
  if (!read) return in_port(spec, read.error());
  return read;
}

std::string port_help(const PortTypes& types) {
  const auto spelling = [](std::string_view name, const ShortForm& form) {
    return fmt::format("{}:{}{}{}", name, form.main, form.port.empty() ? "" : ":", form.port);
  };
  std::string out =
      "A PORT is TYPE:MAIN[,option=value…] or type=TYPE,option=value…; a bare /dev/… is serial:.\n";
  for (const PortType& type : types.all()) {
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
