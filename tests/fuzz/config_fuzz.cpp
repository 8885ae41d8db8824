// Any text as a configuration file of the daemon: no crash, errors that a user can act on, and channels that,
// written down again, are the same ones.

#include <map>
#include <sstream>
#include <string>
#include <string_view>

#include "daemon/channel_check.hpp"
#include "daemon/config_file.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/usage_error.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

using Channels = std::map<std::string, ChannelSpec>;

constexpr std::string_view kName = "fuzz.conf";

Result<Channels> read(const std::string& text) {
  std::istringstream in(text);
  return read_config(in, std::string(kName));
}

std::string written(const Channels& channels) {
  std::string text;
  for (const auto& [name, channel] : channels) {
    text += "[channel " + name + "]\n";
    for (const auto& [option, value] : channel.values) text.append(option).append("=").append(value) += '\n';
  }
  return text;
}

void check_written(const Channels& channels) {
  const Result<Channels> again = read(written(channels));
  require(again.has_value() && again->size() == channels.size(), "channels written down can be read");
  for (const auto& [name, channel] : channels) {
    const auto same = again->find(name);
    require(
        same != again->end() && same->second.mode == channel.mode && same->second.values == channel.values,
        "channels written down are the same");
  }
}

void check_mode(const ChannelSpec& channel) {
  const bool device = channel.values.contains("device");
  const bool tape = channel.values.contains("tape");
  require((channel.mode == ChannelMode::record) == (device && tape), "a device and a tape record");
  require((channel.mode == ChannelMode::replay) == (!device && tape), "a tape alone replays");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Result<Channels> channels = read(std::string(Input(data, size).rest()));
  if (!channels) {
    require_usage(channels.error());
    require(channels.error().message.find(kName) != std::string::npos, "an error names the file");
    return 0;
  }
  require(!channels->empty(), "a configuration has a channel");
  for (const auto& [name, channel] : *channels) {
    require(!name.empty(), "a channel has a name");
    check_mode(channel);
  }
  require(check_channels(*channels).empty(), "what is wrong was told");
  check_written(*channels);
  return 0;
}
