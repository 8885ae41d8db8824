#pragma once

#include <map>
#include <string>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"

namespace porttape {

// Whether the channels of one process are right in themselves, whatever devices and tapes there are: every
// option is good, and no two have the same tape or the same driver's port. Errc::usage names the channel,
// where there are several.
Result<void> check_channels(const std::map<std::string, ChannelSpec>& channels);

}  // namespace porttape
