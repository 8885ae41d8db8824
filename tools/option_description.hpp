#pragma once

#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/options_description.hpp>
#include <boost/program_options/positional_options.hpp>
#include <boost/program_options/variables_map.hpp>

#include "libport/port/port_type.hpp"

namespace porttape {

// The options as Program_options has them; values stay text, to be checked where they are used. `help` is
// also -h, `background` also -b, `jobs` also -j,
// `output` also -o.
boost::program_options::options_description describe(const std::vector<OptionSpec>& specs,
                                                     const std::string& title);

// An option that a verb has not; what() names the nearest one.
class UnknownOption : public boost::program_options::error {
 public:
  UnknownOption(const std::string& what, std::string option) : error(what), option_(std::move(option)) {}
  [[nodiscard]] const std::string& option() const { return option_; }  // without its dashes

 private:
  std::string option_;
};

// A word that is neither an option nor the value of one, where none is taken.
class StrayWord : public boost::program_options::error {
 public:
  StrayWord(const std::string& what, std::string word, std::size_t index)
      : error(what), word_(std::move(word)), index_(index) {}
  [[nodiscard]] const std::string& word() const { return word_; }
  [[nodiscard]] std::size_t index() const { return index_; }  // among the arguments

 private:
  std::string word_;
  std::size_t index_;
};

// Reads a command line; throws boost::program_options::error, whose what() is for the user: the first thing
// that is wrong. Nothing is guessed from a prefix: a script's option must not change its meaning when another
// is added.
boost::program_options::variables_map read_options(
    std::span<const std::string> arguments, const boost::program_options::options_description& options,
    const boost::program_options::positional_options_description& positions = {});

// Those of `specs` that were given; flags as "1".
std::map<std::string, std::string> given_values(const boost::program_options::variables_map& values,
                                                const std::vector<OptionSpec>& specs);

// As --help shows them, in lines of 80 characters at most, behind their title.
std::string as_text(const boost::program_options::options_description& options);

// The message, and where help is ("porttape test"); a question at its end stays the end.
std::string with_help(std::string message, std::string_view command);

// A line to be typed into a shell, as in `with 'quotes' where they are needed`.
std::string shell_line(std::span<const std::string> words);

}  // namespace porttape
