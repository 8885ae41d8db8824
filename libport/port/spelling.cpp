#include "libport/port/spelling.hpp"

#include <algorithm>
#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {
namespace {

bool all_digits(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
}

Error bad_place(std::string_view text) {
  return make_error(Errc::usage,
                    fmt::format("{} is not valid; accepted: HOST, HOST:PORT, [IPv6]:PORT", in_quotes(text)));
}

struct Place {
  std::string_view host;
  std::string_view port;
};

// `host`, `host:port`, `[::1]`, `[::1]:port`; where one listens also `port` alone.
Result<Place> split_place(std::string_view text, bool listen) {
  if (listen && all_digits(text)) return Place{{}, text};
  std::size_t host_end = text.find(':');
  std::string_view host = text.substr(0, host_end);
  if (text.starts_with('[')) {
    const std::size_t bracket = text.find(']');
    if (bracket == std::string_view::npos) return bad_place(text);
    host = text.substr(1, bracket - 1);
    if (host.empty()) return bad_place(text);
    host_end = bracket + 1 < text.size() ? bracket + 1 : std::string_view::npos;
    if (host_end != std::string_view::npos && text[host_end] != ':') return bad_place(text);
  }
  if (host.find('/') != std::string_view::npos) return bad_place(text);  // tcp://host
  if (host_end == std::string_view::npos) return Place{host, {}};
  const std::string_view port = text.substr(host_end + 1);
  if (port.find(':') != std::string_view::npos) return bad_place(text);  // an IPv6 address without brackets
  return Place{host, port};
}

Result<void> set_main(OptionValues& values, std::string_view main, const ShortForm& form, bool listen) {
  if (form.port.empty()) {
    values[std::string(form.main)] = std::string(main);
    return {};
  }
  const Result<Place> place = split_place(main, listen);
  if (!place) return place.error();
  if (!place->host.empty()) values[std::string(form.main)] = std::string(place->host);
  if (!place->port.empty()) values[std::string(form.port)] = std::string(place->port);
  return {};
}

// The short form that these options are spelled in.
const ShortForm& form_of(const PortOptions& options) {
  const PortType& type = *options.type;
  return options.flag("listen") && !type.listening.main.empty() ? type.listening : type.form;
}

// The type's name without the suffix, and whether it was there and means something.
const PortType* find_spelled_type(const PortTypes& types, std::string_view spelled, bool& listen) {
  if (const PortType* type = types.find(spelled)) return type;
  if (!spelled.ends_with(kListenSuffix)) return nullptr;
  const PortType* type = types.find(spelled.substr(0, spelled.size() - kListenSuffix.size()));
  listen = type != nullptr && !type->listening.main.empty();
  return listen ? type : nullptr;
}

}  // namespace

std::vector<std::string_view> split_tokens(std::string_view text, std::string_view separators) {
  std::vector<std::string_view> tokens;
  while (!text.empty()) {
    const std::size_t end = text.find_first_of(separators);
    if (end != 0) tokens.push_back(text.substr(0, end));
    if (end == std::string_view::npos) break;
    text.remove_prefix(end + 1);
  }
  return tokens;
}

std::pair<std::string, std::string> split_option(std::string_view token) {
  const std::size_t equals = token.find('=');
  if (equals == std::string_view::npos) return {std::string(token), "1"};
  return {std::string(token.substr(0, equals)), std::string(token.substr(equals + 1))};
}

namespace {

constexpr std::string_view kDevices = "/dev/";

bool gives_type(std::string_view token) { return token.starts_with("type="); }

// `serial:PATH`, `tcp:HOST:PORT`, for messages.
std::string form_text(const PortType& type, std::string_view spelled, const ShortForm& form) {
  const OptionSpec* const main = type.find(form.main);
  return fmt::format("{}:{}{}", spelled, main == nullptr ? std::string(form.main) : value_name(*main),
                     form.port.empty() ? "" : ":PORT");
}

// The option whose part of the short spelling is empty, and which is not given behind it either; none: empty.
// `TYPE,…` without a colon has no parts.
std::string_view missing_part(const ShortForm& form, bool colon, std::string_view main,
                              const OptionValues& values) {
  const auto given = [&](std::string_view option) { return values.contains(std::string(option)); };
  if (form.port.empty()) return main.empty() && !given(form.main) ? form.main : std::string_view{};
  if (main.empty()) return given(form.main) || (!colon && given(form.port)) ? std::string_view{} : form.main;
  if (main.starts_with(':') && !given(form.main)) return form.main;
  return main.ends_with(':') && !given(form.port) ? form.port : std::string_view{};
}

// An empty part of a short spelling, such as an unset variable of a shell leaves, must not mean a place that
// nobody named: an option that has a default is missing then. Errc::usage.
Result<void> check_parts(const PortType& type, std::string_view spec, std::string_view spelled,
                         const ShortForm& form, bool colon, std::string_view main,
                         const OptionValues& values) {
  const std::string_view part = missing_part(form, colon, main, values);
  const OptionSpec* const option = part.empty() ? nullptr : type.find(part);
  if (option == nullptr || option->default_value.empty()) return {};
  return usage_error(fmt::format("port {}: option '{}' is missing; write {}, or {}={} for the default",
                                 in_quotes(spec), part, form_text(type, spelled, form), part,
                                 option->default_value));
}

Result<OptionValues> short_spelled(const PortTypes& types, std::string_view spec) {
  OptionValues values;
  std::string_view rest = spec;
  std::string_view spelled = "serial";
  bool colon = true;
  if (!spec.starts_with(kDevices)) {
    const std::size_t end = spec.find_first_of(":,");
    spelled = spec.substr(0, end);
    colon = end != std::string_view::npos && spec[end] == ':';
    rest = end == std::string_view::npos ? std::string_view{} : spec.substr(colon ? end + 1 : end);
  }
  bool listen = false;
  const PortType* type = find_spelled_type(types, spelled, listen);
  values.emplace("type", type == nullptr ? spelled : type->name);
  if (type == nullptr) return values;
  if (listen) values.emplace("listen", "1");
  const ShortForm& form = listen ? type->listening : type->form;
  const std::string_view main = rest.substr(0, rest.find(','));
  if (!main.empty()) {
    if (Result<void> set = set_main(values, main, form, listen); !set) return set.error();
  }
  for (const std::string_view token : split_tokens(rest.substr(main.size()), ",")) {
    auto [key, value] = split_option(token);
    values[std::move(key)] = std::move(value);
  }
  if (Result<void> whole = check_parts(*type, spec, spelled, form, colon, main, values); !whole)
    return whole.error();
  return values;
}

}  // namespace

bool names_type(const PortTypes& types, std::string_view spec) {
  bool listen = false;
  return spec.starts_with(kDevices) || std::ranges::any_of(split_tokens(spec, kSeparators), gives_type) ||
         find_spelled_type(types, spec.substr(0, spec.find_first_of(":,")), listen) != nullptr;
}

Result<OptionValues> read_spelling(const PortTypes& types, std::string_view spec) {
  const std::vector<std::string_view> tokens = split_tokens(spec, kSeparators);
  if (tokens.empty()) {
    return make_error(
        Errc::usage, fmt::format("a port is missing; name one as TYPE:MAIN[,option=value…] with a type of {}",
                                 types.names()));
  }
  if (std::ranges::none_of(tokens, gives_type)) return short_spelled(types, spec);
  OptionValues values;
  for (const std::string_view token : tokens) {
    auto [key, value] = split_option(token);
    values[std::move(key)] = std::move(value);
  }
  return values;
}

std::string host_and_port(std::string_view host, long port) {
  return host.find(':') == std::string_view::npos ? fmt::format("{}:{}", host, port)
                                                  : fmt::format("[{}]:{}", host, port);
}

std::string short_spelling(const PortOptions& options) {
  std::string text = short_name(options);
  const ShortForm& form = form_of(options);
  const bool listens = &form == &options.type->listening;
  const bool has_main = !options.text(std::string(form.main)).empty();
  for (const auto& [option, value] : options.values) {
    if (has_main && (option == form.main || option == form.port)) continue;
    if (listens && option == "listen") continue;
    const OptionSpec* spec = options.type->find(option);
    const bool is_flag = spec != nullptr && spec->kind == OptionSpec::Kind::flag;
    text += ',';
    text += option;
    if (!is_flag) text.append("=").append(value);
  }
  return text;
}

std::string short_name(const PortOptions& options) {
  const ShortForm& form = form_of(options);
  std::string spelled(options.type->name);
  if (&form == &options.type->listening) spelled += kListenSuffix;
  const std::string main = options.text(std::string(form.main));
  if (main.empty()) return spelled;
  return fmt::format("{}:{}", spelled,
                     form.port.empty() ? main : host_and_port(main, options.integer(std::string(form.port))));
}

}  // namespace porttape
