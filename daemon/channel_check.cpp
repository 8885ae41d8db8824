#include "daemon/channel_check.hpp"

#include <filesystem>
#include <fmt/format.h>
#include <system_error>

#include "libport/port/port_options.hpp"

namespace porttape {
namespace {

using Owners = std::map<std::string, std::string>;  // what only one channel can have, and which has it

// One spelling for one place, as far as its folders are there.
std::string place(const std::string& path) {
  std::error_code error;
  const std::filesystem::path absolute = std::filesystem::absolute(path, error);
  const std::filesystem::path folder = std::filesystem::weakly_canonical(absolute.parent_path(), error);
  return ((error ? absolute.parent_path() : folder) / absolute.filename()).lexically_normal().string();
}

Result<void> claim(Owners& owners, const PortType::Claim& wanted, const std::string& channel) {
  const auto& [kind, where] = wanted;
  const bool is_path = kind == "link" || kind == "socket" || kind == "tape";
  const std::string what = kind + " " + (is_path ? place(where) : where);
  const auto [owner, free] = owners.emplace(what, channel);
  if (free) return {};
  return make_error(Errc::usage,
                    fmt::format("{} is that of channel '{}'; name another", what, owner->second));
}

Result<void> check_channel(Owners& owners, const std::string& name, const ChannelSpec& spec) {
  const Result<ChannelPorts> ports = named_ports(spec);
  if (!ports) return ports.error();
  for (const PortSpec* port : {&ports->driver, &ports->device}) {
    for (const PortType::Claim& wanted : port->type().claims(*port)) {
      if (Result<void> free = claim(owners, wanted, name); !free) return free;
    }
  }
  return {};
}

}  // namespace

Result<void> check_channels(const std::map<std::string, ChannelSpec>& channels) {
  Owners owners;
  for (const auto& [name, spec] : channels) {
    const Result<void> good = check_channel(owners, name, spec);
    if (good) continue;
    if (channels.size() == 1) return good;
    return make_error(good.error().code, fmt::format("channel '{}': {}", name, good.error().message));
  }
  return {};
}

}  // namespace porttape
