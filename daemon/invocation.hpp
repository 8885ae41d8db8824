#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <spdlog/common.h>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"

namespace porttape {

// What a command line of porttaped asks for.
struct Invocation {
  std::optional<std::string> print;  // --help, --version: print this and end
  std::map<std::string, ChannelSpec>
      channels;  // by name; the verbs record, replay and bridge make one, named after the verb
  std::string verb;
  bool keeps_channels = false;  // the verb `run`
  spdlog::level::level_enum log_level = spdlog::level::info;
  std::string log_file;
  bool background = false;
  std::string pid_file;
};

// Reads arguments (without the program's name), and the configuration file of the verb `run`.
Result<Invocation> parse_invocation(std::span<const std::string> arguments);

}  // namespace porttape
