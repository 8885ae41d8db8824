// Any text as a port, in either spelling, and any map of options: no crash, errors that a user can act on,
// and what was understood can be written down and understood again.
//
// The first byte chooses: even, the rest is a text for parse_port(); odd, lines of NAME=VALUE for
// check_options().

#include <string>
#include <string_view>

#include "libport/catalog/port_types.hpp"
#include "libport/port/spelling.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/usage_error.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

// By what they mean: a default that is written down is the same, 007 is 7.
void require_same(const PortOptions& left, const PortOptions& right) {
  require(left.type == right.type, "the spelling has the type");
  for (const OptionSpec& option : left.type->options) {
    const std::string name(option.name);
    const bool number = option.kind == OptionSpec::Kind::integer || option.kind == OptionSpec::Kind::number;
    require(number ? left.number(name) == right.number(name) : left.text(name) == right.text(name),
            "the spelling has every option");
  }
}

void check_values_of(const PortOptions& options) {
  for (const auto& [name, value] : options.values) {
    const OptionSpec* spec = options.type->find(name);
    require(spec != nullptr, "only known options are let in");
    const Result<std::string> again = check_value(*spec, value);
    require(again && *again == value, "a canonical value stays as it is");
  }
}

// Not with a separator within a value, and not with a bracket or a slash that belongs to a host.
bool can_be_spelled(const PortOptions& options) {
  for (const auto& [name, value] : options.values) {
    if (value.find_first_of(kSeparators) != std::string::npos) return false;
    if (name.ends_with("ip") && value.find_first_of("[]/") != std::string::npos) return false;
  }
  return true;
}

void check_spelling(const PortOptions& options) {
  const std::string spelled = options.spelled();
  require(spelled.starts_with(options.name()), "a spelling begins with the name");
  const Result<PortOptions> again = parse_options(port_types(), spelled);
  require(again.has_value(), "a spelling can be parsed");
  require_same(options, *again);
  require(again->spelled() == spelled, "a spelling is spelled as itself");
}

void check(const Result<PortOptions>& options) {
  if (!options) return require_usage(options.error());
  check_values_of(*options);
  if (can_be_spelled(*options)) check_spelling(*options);
  const Result<PortSpec> spec = PortSpec::read(*options);
  if (!spec) return require_usage(spec.error());
  require(spec->written() == *options, "a port keeps what was written");
  for (const PortType::Claim& claim : spec->type().claims(*spec))
    require(!claim.first.empty() && !claim.second.empty(), "a claim has a kind and a place");
}

OptionValues values_of(std::string_view lines) {
  OptionValues values;
  for (const std::string_view line : split_tokens(lines, "\n")) {
    auto [name, value] = split_option(line);
    values[std::move(name)] = std::move(value);
  }
  return values;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  const bool as_map = input(2) == 1;
  const std::string_view text = input.rest();
  if (as_map) {
    check(check_options(values_of(text)));
    return 0;
  }
  const Result<PortOptions> options = parse_options(port_types(), text);
  check(options);
  const Result<PortSpec> port = parse_port(text);
  if (!port) require_usage(port.error());
  require(!port || (options && port->written() == *options), "parse_port() reads what parse_options() does");
  return 0;
}
