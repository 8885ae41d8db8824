#pragma once

#include <istream>
#include <map>
#include <string>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"

namespace porttape {

// The channels of an INI file of `[channel NAME]` sections. The mode follows from the keys: device and tape
// record, tape alone replays, device alone bridges. `on-existing` is `next` unless given. Errc::usage names
// the file and what is wrong in it.
Result<std::map<std::string, ChannelSpec>> read_config_file(const std::string& path);
Result<std::map<std::string, ChannelSpec>> read_config(std::istream& in, const std::string& name);

}  // namespace porttape
