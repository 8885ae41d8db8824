#include "tools/supervision.hpp"

#include <fmt/format.h>
#include <utility>

namespace porttape {
namespace {

std::optional<std::string> take_value(std::map<std::string, std::string>& values, const char* option) {
  const auto given = values.extract(option);
  return given ? std::optional(given.mapped()) : std::nullopt;
}

}  // namespace

std::vector<OptionSpec> supervision_options(bool flag) {
  std::vector<OptionSpec> specs;
  if (flag) {
    specs.push_back({.name = "exec",
                     .kind = OptionSpec::Kind::flag,
                     .help = "run the command as `porttape exec` does: with what a pty lacks"});
  }
  specs.push_back({.name = "lines",
                   .help = "modem lines where device and tape have none: on (the default), off, loopback, or "
                           "some of cts=, dsr=, "
                           "cd=, ri= with on or off",
                   .value_name = "LINES"});
  specs.push_back({.name = "as",
                   .help = "the port as the command finds it, by name and in lists of ports: "
                           "/dev/ttyUSB0,vid=0403,pid=6001,serial=PT0001 (manufacturer=, product=, "
                           "interface=, driver=, location=), a path alone, or none; default: as device or "
                           "tape know it",
                   .value_name = "PORT"});
  return specs;
}

Result<std::optional<Supervision>> take_supervision(std::map<std::string, std::string>& values, bool flag) {
  const bool wanted = !flag || take_value(values, "exec").has_value();
  const std::optional<std::string> lines = take_value(values, "lines");
  const std::optional<std::string> as = take_value(values, "as");
  if (!wanted && as) return make_error(Errc::usage, "option 'as' goes with --exec");
  if (!wanted && lines) return make_error(Errc::usage, "option 'lines' goes with --exec");
  if (!wanted) return std::optional<Supervision>();
  Supervision supervision;
  if (lines) {
    const Result<LineDefaults> parsed = parse_line_defaults(*lines);
    if (!parsed) return make_error(Errc::usage, fmt::format("option 'lines': {}", parsed.error().message));
    supervision.lines = *parsed;
  }
  supervision.finds = as != "none";
  if (as && supervision.finds) {
    const Result<PortIdentity> parsed = parse_identity(*as);
    if (!parsed) return make_error(Errc::usage, fmt::format("option 'as': {}", parsed.error().message));
    supervision.as = *parsed;
  }
  return std::optional(supervision);
}

}  // namespace porttape
