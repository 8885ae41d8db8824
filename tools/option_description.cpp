#include "tools/option_description.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <sstream>
#include <utility>

#include <boost/program_options/parsers.hpp>
#include <boost/program_options/value_semantic.hpp>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/port/help_table.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::array<std::pair<std::string_view, std::string_view>, 4> kLetters = {
    {{"help", "h"}, {"background", "b"}, {"jobs", "j"}, {"output", "o"}}};

std::string with_letter(std::string_view name) {
  const auto* const letter = std::ranges::find(kLetters, name, [](const auto& row) { return row.first; });
  return letter == kLetters.end() ? std::string(name) : fmt::format("{},{}", name, letter->second);
}

std::string without_dashes(std::string_view option) {
  return std::string(option.substr(std::min(option.find_first_not_of('-'), option.size())));
}

UnknownOption unknown_option(const std::string& token, const po::options_description& options) {
  const std::string option = token.substr(0, token.find('='));
  const std::string name = without_dashes(option);
  std::vector<std::string> words;
  for (const auto& each : options.options()) words.push_back("--" + each->long_name());
  const std::vector<std::string_view> known(words.begin(), words.end());
  return {fmt::format("unknown option {}{}", in_quotes(option), did_you_mean("--" + name, known)), name};
}

// Gives the words that are no options their names by position.
void take_words(po::parsed_options& parsed, const po::options_description& options,
                const po::positional_options_description& positions) {
  std::size_t index = 0;
  for (po::option& each : parsed.options) {
    if (each.unregistered) throw unknown_option(each.original_tokens.front(), options);
    if (each.position_key >= 0) {
      const std::string& word = each.value.front();
      if (static_cast<unsigned>(each.position_key) >= positions.max_total_count())
        throw StrayWord(fmt::format("{} is not an option; options begin with --", in_quotes(word)), word,
                        index);
      each.string_key = positions.name_for_position(static_cast<unsigned>(each.position_key));
    }
    index += each.original_tokens.size();
  }
}

// What is wrong with an option that is known.
std::string wrong_use(const po::error_with_option_name& error, const po::options_description& options) {
  using Syntax = po::invalid_command_line_syntax;
  const std::string name = without_dashes(error.get_option_name());
  const po::option_description* const known = options.find_nothrow(name, false);
  const std::string value = known == nullptr ? "VALUE" : known->semantic()->name();
  if (dynamic_cast<const po::multiple_occurrences*>(&error) != nullptr)
    return fmt::format("option '--{}' is given twice; give it once", name);
  const auto* const syntax = dynamic_cast<const Syntax*>(&error);
  if (syntax != nullptr && syntax->kind() == Syntax::extra_parameter)
    return fmt::format("option '--{}' takes no value; leave out what is behind it", name);
  return fmt::format("option '--{}' has no value; type --{} {}", name, name, value);
}

void check_not_empty(const po::variables_map& values, const po::options_description& options) {
  for (const auto& [name, value] : values) {
    const bool takes_value = options.find(name, false).semantic()->max_tokens() > 0;
    const auto* const text = boost::any_cast<std::string>(&value.value());
    if (!takes_value || text == nullptr || !text->empty()) continue;
    throw po::error(fmt::format("option '--{}' is empty; type --{} {}", name, name,
                                options.find(name, false).semantic()->name()));
  }
}

std::string title_of(const po::options_description& options) {
  std::ostringstream out;
  out << options;
  return out.str().substr(0, out.str().find('\n') + 1);
}

}  // namespace

po::options_description describe(const std::vector<OptionSpec>& specs, const std::string& title) {
  po::options_description options(title);
  for (const OptionSpec& spec : specs) {
    const std::string name = with_letter(spec.name);
    const std::string help = help_of(spec);
    if (spec.kind == OptionSpec::Kind::flag) {
      options.add_options()(name.c_str(), help.c_str());
    } else {
      options.add_options()(name.c_str(), po::value<std::string>()->value_name(value_name(spec)),
                            help.c_str());
    }
  }
  return options;
}

po::variables_map read_options(std::span<const std::string> arguments, const po::options_description& options,
                               const po::positional_options_description& positions) {
  po::variables_map values;
  try {
    po::parsed_options parsed =
        po::command_line_parser(std::vector<std::string>(arguments.begin(), arguments.end()))
            .options(options)
            .allow_unregistered()
            .style(po::command_line_style::unix_style & ~po::command_line_style::allow_guessing)
            .run();
    take_words(parsed, options, positions);
    po::store(parsed, values);
  } catch (const po::error_with_option_name& error) {
    throw po::error(wrong_use(error, options));
  }
  po::notify(values);
  check_not_empty(values, options);
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
  std::vector<HelpRow> rows;
  for (const auto& option : options.options()) {
    std::string left = "--" + option->long_name();
    const std::string letter = option->canonical_display_name(po::command_line_style::allow_dash_for_short);
    if (letter.starts_with('-') && !letter.starts_with("--")) left = letter + ", " + left;
    if (option->semantic()->max_tokens() > 0) left += " " + option->semantic()->name();
    rows.push_back({std::move(left), option->description()});
  }
  return title_of(options) + help_table(rows);
}

std::string with_help(std::string message, std::string_view command) {
  if (!message.ends_with('?')) message += fmt::format("; see {} --help", command);
  return message;
}

std::string shell_line(std::span<const std::string> words) {
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : " ") + shell_word(word);
  return line;
}

}  // namespace porttape
