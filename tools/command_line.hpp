#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/variables_map.hpp>

#include "tools/output.hpp"
#include "tools/verbs.hpp"

namespace porttape {

// What the --help of a verb says around the list of options.
struct VerbHelp {
  std::string_view verb;
  std::string_view usage;     // behind "porttape VERB"
  std::string_view about;     // wrapped where it is shown
  std::string_view examples;  // whole lines
};

// The command line of a verb: its options, and TAPE arguments unless it takes something else.
//
// Add the options first, then parse(). Options are never guessed from a prefix; `--` ends them.
class CommandLine {
 public:
  explicit CommandLine(const VerbHelp& help);

  CommandLine& flag(const char* name, const char* help);
  CommandLine& takes_nothing();
  CommandLine& takes_words();  // or none
  CommandLine& color();        // --color auto|always|never
  CommandLine& value(const char* name, const char* value_name, const char* help);

  // The exit status if the verb has nothing more to do: --help was asked for, or what was given makes no
  // sense.
  [[nodiscard]] std::optional<int> parse(Arguments args, std::ostream& out, std::ostream& err);

  // One line that says what is wrong and where help is; the exit status for it.
  int usage_error(std::ostream& err, std::string_view what) const;

  [[nodiscard]] bool has(const std::string& option) const { return values_.count(option) > 0; }
  [[nodiscard]] std::optional<std::string> text(const std::string& option) const;
  // Whether `out` gets colours.
  [[nodiscard]] bool colors(const std::ostream& out) const { return wants_color(out, color_); }
  [[nodiscard]] const std::vector<std::string>& tapes() const { return words_; }
  [[nodiscard]] const std::vector<std::string>& words() const { return words_; }

 private:
  void print_help(std::ostream& out) const;

  VerbHelp help_;
  boost::program_options::options_description options_;
  boost::program_options::variables_map values_;
  enum class Takes { tapes, words, nothing };
  Takes takes_ = Takes::tapes;
  std::vector<std::string> words_;
  ColorChoice color_ = ColorChoice::automatic;
};

}  // namespace porttape
