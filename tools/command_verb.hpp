#pragma once

#include <functional>
#include <map>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/port/port_type.hpp"
#include "tools/verbs.hpp"

namespace porttape {

// A verb that runs a command on a session: `porttape NAME [options] -- COMMAND…`.
struct CommandVerb {
  std::string_view name;
  std::string_view usage;           // behind "porttape NAME"
  std::string_view about;           // before the list of options
  std::vector<OptionSpec> options;  // besides --help and --driver, which has a default here
  std::string_view example;         // behind "porttape NAME"
  std::string_view alone = {};      // the option with which there is neither a command nor a port
  bool has_port = true;             // of ours, for the command
};

// The options of a mode for a verb that ends by itself: neither `once`, nor a clock that stands until
// somebody steers it by the daemon's control socket.
std::vector<OptionSpec> options_of_one_run(ChannelMode mode);

// What was typed; the values by option, unchecked.
struct CommandVerbLine {
  std::map<std::string, std::string> values;
  std::vector<std::string> command;
  bool own_driver = false;  // none was named
};

// Reads the command line and does `work`, whose exit status it gives; the driver's port is a pty in a folder
// of its own where none is named. Answers --help, and tells what is wrong on `err`.
int run_command_verb(const CommandVerb& verb, Arguments args, std::ostream& out, std::ostream& err,
                     const std::function<Result<int>(CommandVerbLine line)>& work);

}  // namespace porttape
