#pragma once

#include <map>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"

namespace porttape {

struct ChannelProblem {
  std::string channel;
  OptionProblem problem;
};

// All that is wrong with channels that are to run at the same time: their options, and what two of them want
// and only one can have, a link, a port to listen on or a tape. Looks at folders, opens nothing.
std::vector<ChannelProblem> check_channels(const std::map<std::string, ChannelSpec>& channels);

}  // namespace porttape
