#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/positional_options.hpp>
#include <boost/program_options/variables_map.hpp>

#include "libport/port/port_type.hpp"

namespace porttape {

// The options as Program_options has them; values stay text, to be checked where they are used.
boost::program_options::options_description describe(const std::vector<OptionSpec>& specs,
                                                     const std::string& title);

// Reads a command line; throws boost::program_options::error. Nothing is guessed from a prefix: a script's
// option must not change its meaning when another is added.
boost::program_options::variables_map read_options(
    std::span<const std::string> arguments, const boost::program_options::options_description& options,
    const boost::program_options::positional_options_description& positions = {});

// Those of `specs` that were given; flags as "1".
std::map<std::string, std::string> given_values(const boost::program_options::variables_map& values,
                                                const std::vector<OptionSpec>& specs);

// As --help shows them.
std::string as_text(const boost::program_options::options_description& options);

}  // namespace porttape
