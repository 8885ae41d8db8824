#pragma once

#include <istream>
#include <map>
#include <string>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"

namespace porttape {

// The channels of an INI file: sections `[channel NAME]` with lines `KEY = VALUE`, each key once; from a #
// on, and in lines that begin with a ;, stands a comment. The mode follows from the keys: device and tape
// record, tape alone replays, device alone bridges. `on-existing` is `next` unless given.
//
// Errc::usage has everything that is wrong, a line each, as FILE:LINE: WHAT: what cannot be read, keys and
// values that no channel of the mode has, and what two channels cannot have at once.
Result<std::map<std::string, ChannelSpec>> read_config_file(const std::string& path);
Result<std::map<std::string, ChannelSpec>> read_config(std::istream& in, const std::string& name);

}  // namespace porttape
