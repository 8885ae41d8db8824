#include "libport/port/port_options.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <fmt/format.h>
#include <utility>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/port/help_table.hpp"
#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

Error in_port(std::string_view spec, const Error& error) {
  return make_error(error.code, fmt::format("port {}: {}", in_quotes(spec), error.message));
}

// What others call our types.
constexpr std::array<std::pair<std::string_view, std::string_view>, 9> kOtherNames = {
    {{"tty", "serial"},
     {"com", "serial"},
     {"uart", "serial"},
     {"usb", "serial"},
     {"socket", "tcp"},
     {"server", "tcp-listen"},
     {"tcp-server", "tcp-listen"},
     {"tape", "logreader"},
     {"replay", "logreader"}}};

Error unknown_type(const PortTypes& types, std::string_view name) {
  const std::vector<std::string> spellings = types.spellings();
  const std::vector<std::string_view> known(spellings.begin(), spellings.end());
  const auto* const other = std::ranges::find(kOtherNames, name, [](const auto& row) { return row.first; });
  std::string end = other == kOtherNames.end() ? did_you_mean(name, known)
                                               : fmt::format("; did you mean '{}'?", other->second);
  if (end.empty()) end = "; accepted: " + types.names();
  return usage_error(fmt::format("unknown type {}{}", in_quotes(name), end));
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
  const auto mode = whole_number<unsigned>(value, 8);
  if (!mode || value.size() > 4 || *mode > 0777) {
    return usage_error(fmt::format("option '{}': {} is not valid; accepted: octal permissions like 0660",
                                   option, in_quotes(value)));
  }
  return *mode;
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
  if (!name || name.mapped().empty())
    return usage_error("option 'type' is missing; accepted: " + types.names());
  const PortType* type = types.find(name.mapped());
  if (type == nullptr) return unknown_type(types, name.mapped());
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

namespace {

std::vector<HelpRow> rows_of(std::span<const OptionSpec> options) {
  std::vector<HelpRow> rows;
  for (const OptionSpec& option : options) {
    const std::string value = value_name(option);
    rows.push_back({std::string(option.name) + (value.empty() ? "" : "=" + value), help_of(option)});
  }
  return rows;
}

std::string heading_of(const PortType& type) {
  const auto spelling = [](std::string_view name, const ShortForm& form) {
    return fmt::format("{}:{}{}{}", name, form.main, form.port.empty() ? "" : ":", form.port);
  };
  std::string text = fmt::format("\n{}  {}\n", spelling(type.name, type.form), type.help);
  if (!type.listening.main.empty())
    text += spelling(std::string(type.name) + std::string(kListenSuffix), type.listening) + "\n";
  return text;
}

// The options that every type has.
std::vector<OptionSpec> options_of_all(const PortTypes& types) {
  std::vector<OptionSpec> common = types.all().front().options;
  std::erase_if(common, [&](const OptionSpec& option) {
    return !std::ranges::all_of(types.all(),
                                [&](const PortType& type) { return type.find(option.name) != nullptr; });
  });
  return common;
}

// The options that not all types have; of a type that records another, its own.
std::vector<OptionSpec> own_options(const PortTypes& types, const PortType& type) {
  std::vector<OptionSpec> own = type.options;
  const std::vector<OptionSpec> common = options_of_all(types);
  const PortType* const recorded = type.records.empty() ? nullptr : types.find(type.records);
  std::erase_if(own, [&](const OptionSpec& option) {
    return std::ranges::find(common, option.name, &OptionSpec::name) != common.end() ||
           (recorded != nullptr && recorded->find(option.name) != nullptr);
  });
  return own;
}

}  // namespace

std::string port_help(const PortTypes& types) {
  std::string out =
      "A PORT is one end of a line: TYPE:MAIN[,option=value…] or\n"
      "type=TYPE,option=value…; a bare /dev/… is serial:. Options without a value are\n"
      "off unless named. No default is taken for an empty MAIN. Examples:\n\n"
      "  /dev/ttyUSB0,baud=115200       pty:/tmp/laser       tcp:10.0.0.5:2112\n"
      "  tcp-listen:127.0.0.1:2112      unix:/run/x          udp-listen:10110\n";
  for (const PortType& type : types.all()) {
    out += heading_of(type) + help_table(rows_of(own_options(types, type)));
    if (!type.records.empty()) out += fmt::format("  and the options of {}\n", type.records);
  }
  return out + "\nevery type\n" + help_table(rows_of(options_of_all(types)));
}

}  // namespace porttape
