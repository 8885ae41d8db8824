#include "tools/command_line.hpp"

#include <fmt/format.h>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/positional_options.hpp>
#include <boost/program_options/value_semantic.hpp>

#include "libport/base/error.hpp"
#include "libport/base/printable.hpp"
#include "libport/port/help_table.hpp"
#include "tools/option_description.hpp"

namespace porttape {

namespace po = boost::program_options;

CommandLine::CommandLine(const VerbHelp& help) : help_(help), options_("Options") {
  options_.add_options()("help,h", "this text");
}

CommandLine& CommandLine::flag(const char* name, const char* help) {
  options_.add_options()(name, help);
  return *this;
}

CommandLine& CommandLine::takes_nothing() {
  takes_ = Takes::nothing;
  return *this;
}

CommandLine& CommandLine::takes_words() {
  takes_ = Takes::words;
  return *this;
}

CommandLine& CommandLine::color() {
  const OptionSpec color = color_option();
  return value("color", value_name(color).c_str(), help_of(color).c_str());
}

CommandLine& CommandLine::value(const char* name, const char* value_name, const char* help) {
  options_.add_options()(name, po::value<std::string>()->value_name(value_name), help);
  return *this;
}

std::optional<int> CommandLine::parse(Arguments args, std::ostream& out, std::ostream& err) {
  po::options_description all;
  all.add(options_).add_options()("tape", po::value<std::vector<std::string>>(&words_));
  po::positional_options_description positional;
  positional.add("tape", -1);
  try {
    values_ = read_options(args, all, positional);
  } catch (const po::error& wrong) {
    return usage_error(err, wrong.what());
  }
  if (has("help")) {
    print_help(out);
    return exit_status::kPass;
  }
  if (const auto given = text("color")) {
    const Result<ColorChoice> choice = read_color(*given);
    if (!choice) return usage_error(err, choice.error().message);
    color_ = *choice;
  }
  if (takes_ == Takes::tapes && words_.empty())
    return usage_error(err, fmt::format("no tape given; type porttape {} TAPE", help_.verb));
  if (takes_ == Takes::nothing && !words_.empty())
    return usage_error(err, in_quotes(words_.front()) + " is too much; only options are taken");
  return std::nullopt;
}

int CommandLine::usage_error(std::ostream& err, std::string_view what) const {
  const std::string command = fmt::format("porttape {}", help_.verb);
  err << command << ": " << printable_lines(with_help(std::string(what), command)) << '\n';
  return exit_status::kUsage;
}

std::optional<std::string> CommandLine::text(const std::string& option) const {
  const auto found = values_.find(option);
  if (found == values_.end()) return std::nullopt;
  return found->second.as<std::string>();
}

void CommandLine::print_help(std::ostream& out) const {
  out << help_text(fmt::format("Usage: porttape {} {}", help_.verb, help_.usage), 7) << '\n'
      << help_text(help_.about) << '\n'
      << as_text(options_) << "\nExamples:\n"
      << help_.examples;
}

}  // namespace porttape
