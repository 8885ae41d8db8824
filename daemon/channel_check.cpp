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

// What a port needs for itself alone; empty when it is not known to need anything.
std::string claim_of(const PortOptions& port) {
  const std::string type = port.type.ends_with("log") ? port.type.substr(0, port.type.size() - 3) : port.type;
  const auto address = [&port](const char* host, const char* number) {
    return port.integer(number) == 0 ? "" : fmt::format("{}:{}", port.text(host), port.integer(number));
  };
  if (type == "pty" && !port.text("link").empty()) return "link " + place(port.text("link"));
  if (type == "unix" && port.flag("listen")) return "socket " + place(port.text("path"));
  if (type == "tcp" && port.flag("listen")) {
    const std::string at = address("ip", "port");
    return at.empty() ? at : "TCP port " + at;
  }
  if (type == "udp") {
    const std::string at = address("recv_ip", "recv_port");
    return at.empty() ? at : "UDP port " + at;
  }
  return {};
}

Result<void> claim(Owners& owners, const std::string& what, const std::string& channel) {
  if (what.empty()) return {};
  const auto [owner, free] = owners.emplace(what, channel);
  if (free) return {};
  return make_error(Errc::usage,
                    fmt::format("{} is that of channel '{}'; name another", what, owner->second));
}

Result<void> check_channel(Owners& owners, const std::string& name, const ChannelSpec& spec) {
  const Result<ChannelPorts> ports = named_ports(spec);
  if (!ports) return ports.error();
  for (const PortOptions* port : {&ports->driver, &ports->device}) {
    if (port->type.ends_with("log")) {
      if (Result<void> free = claim(owners, "tape " + place(port->text("file")), name); !free) return free;
    }
    if (Result<void> free = claim(owners, claim_of(*port), name); !free) return free;
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
