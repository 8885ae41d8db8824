#include "tools/option_description.hpp"

#include <fmt/format.h>
#include <sstream>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/parsers.hpp>
#include <boost/program_options/value_semantic.hpp>

namespace porttape {

namespace po = boost::program_options;

po::options_description describe(const std::vector<OptionSpec>& specs, const std::string& title) {
  po::options_description options(title);
  for (const OptionSpec& spec : specs) {
    const std::string name(spec.name);
    const std::string fallback = spec.default_value.empty() ? "" : fmt::format(" [{}]", spec.default_value);
    const std::string help = std::string(spec.help) + fallback;
    if (spec.kind == OptionSpec::Kind::flag) {
      options.add_options()(name.c_str(), help.c_str());
    } else {
      options.add_options()(name.c_str(), po::value<std::string>(), help.c_str());
    }
  }
  return options;
}

po::variables_map read_options(std::span<const std::string> arguments, const po::options_description& options,
                               const po::positional_options_description& positions) {
  po::variables_map values;
  try {
    po::store(po::command_line_parser(std::vector<std::string>(arguments.begin(), arguments.end()))
                  .options(options)
                  .positional(positions)
                  .style(po::command_line_style::unix_style & ~po::command_line_style::allow_guessing)
                  .run(),
              values);
  } catch (const po::error_with_option_name& error) {
    // Its what() never ends where the name has one of its placeholders in it.
    const std::string name = error.get_option_name();
    if (name.find('%') == std::string::npos) throw;
    throw po::error(fmt::format("unrecognised option '{}'", name));
  }
  po::notify(values);
  return values;
}

std::map<std::string, std::string> given_values(const po::variables_map& values,
                                                const std::vector<OptionSpec>& specs) {
  std::map<std::string, std::string> given;
  for (const OptionSpec& spec : specs) {
    const std::string name(spec.name);
    if (!values.contains(name)) continue;
    given[name] = spec.kind == OptionSpec::Kind::flag ? "1" : values[name].as<std::string>();
  }
  return given;
}

std::string as_text(const po::options_description& options) {
  std::ostringstream out;
  out << options;
  return out.str();
}

}  // namespace porttape
