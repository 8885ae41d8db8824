#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/port/port_options.hpp"

namespace porttape {

// What a channel does; also the verb that makes one: of the daemon, and `drive`, a tape in the driver's
// place, of the tool.
enum class ChannelMode { record, replay, bridge, drive };
std::string_view to_string(ChannelMode mode);

// Whose an option is that `mode` has not, as a message: another mode's, or a port's. Nothing where nobody has
// it.
std::optional<std::string> owner_of_option(std::string_view option, ChannelMode mode);

// The options of a mode, for a command line, a configuration file and --help. Replay has the verb's defaults
// here (strictness 1, reactive), not flexiport's.
std::vector<OptionSpec> channel_options(ChannelMode mode);

// A driver's and a device's end, as a user describes them: option name to value, as written. Both programs
// and the configuration file make one of these.
struct ChannelSpec {
  ChannelMode mode = ChannelMode::bridge;
  std::map<std::string, std::string> values;
};

// The two ports that a channel joins. Errc::usage names the option that is wrong, or the tape that is
// missing.
struct ChannelPorts {
  PortSpec driver;
  PortSpec device;
  bool each_connection = false;  // has a line of its own (connections=each)
};
Result<ChannelPorts> channel_ports(const ChannelSpec& spec);

// What is wrong with one of a channel's options; without a name, with what is missing or does not go
// together.
struct OptionProblem {
  std::string option;
  Error error;
};

// A channel by its options alone, whether the tape of a replay is there or not: the ports that are good, and
// everything that is wrong.
struct ReadChannel {
  std::optional<PortSpec> driver;
  std::optional<PortSpec> device;
  bool each_connection = false;
  std::vector<OptionProblem> problems;
};
ReadChannel read_channel(const ChannelSpec& spec);

}  // namespace porttape
