#include "libport/net/types.hpp"

#include <fmt/format.h>
#include <memory>
#include <string>

#include "libport/net/socket_address.hpp"
#include "libport/net/tcp_port.hpp"
#include "libport/net/udp_port.hpp"
#include "libport/net/unix_port.hpp"
#include "libport/port/port_options.hpp"
#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;
using Claims = std::vector<PortType::Claim>;

constexpr double kMaxPort = 65535;  // 0 is for the listening ones

const OptionSpec kWait{"wait", Kind::flag, "", "waits for a device that is missing, else that is an error"};
const OptionSpec kMaxConnections{"max-connections",
                                 Kind::integer,
                                 "256",
                                 "with listen and --connections each, the most at once; more are refused",
                                 1,
                                 100'000};

std::uint16_t port_number(const PortOptions& written, const std::string& option) {
  return static_cast<std::uint16_t>(written.integer(option));
}

StreamOptions stream_options(const PortOptions& written) {
  return {.listen = written.flag("listen"),
          .wait = written.flag("wait"),
          .most_connections = static_cast<std::size_t>(written.integer("max-connections"))};
}

// An empty one, such as an unset variable of a shell leaves, would mean each of this machine's addresses.
Result<void> check_host(const PortOptions& written, const std::string& option) {
  if (!written.text(option).empty()) return {};
  return usage_error(fmt::format("option '{}': '' is not valid; accepted: a name or an address", option));
}

Result<TcpOptions> tcp_options(const PortOptions& written) {
  if (const Result<void> named = check_host(written, "ip"); !named) return named.error();
  TcpOptions options{written.text("ip"), port_number(written, "port"), stream_options(written)};
  if (options.port == 0 && !options.stream.listen)
    return usage_error("option 'port': '0' is not valid; accepted: a whole number from 1 to 65535");
  return options;
}

Result<UdpOptions> udp_options(const PortOptions& written) {
  for (const char* const option : {"dest_ip", "recv_ip"}) {
    if (const Result<void> named = check_host(written, option); !named) return named.error();
  }
  const std::string from = written.text("from");
  return UdpOptions{.to_host = written.text("dest_ip"),
                    .to_port = port_number(written, "dest_port"),
                    .own_host = written.text("recv_ip"),
                    .own_port = port_number(written, "recv_port"),
                    .listen = written.flag("listen"),
                    .from = from == "peer"  ? UdpOptions::From::peer
                            : from == "any" ? UdpOptions::From::any
                                            : UdpOptions::From::as_usual};
}

Result<UnixOptions> unix_options(const PortOptions& written) {
  const std::string path = written.text("path");
  if (path.empty()) return usage_error("option 'path' is missing; accepted: the path of a socket");
  if (const Result<SocketAddress> address = unix_address(path); !address) return address.error();
  const Result<unsigned> mode = written.mode("mode");
  if (!mode) return mode.error();
  return UnixOptions{path, *mode, stream_options(written)};
}

Claims claim_address(const char* kind, const std::string& host, std::uint16_t port) {
  return port == 0 ? Claims() : Claims{{kind, host_and_port(host, port)}};
}

}  // namespace

PortType tcp_type() {
  PortType type{"tcp", {"ip", "port"}, "a TCP connection"};
  type.listening = {"ip", "port"};
  type.recorded_as = "tcplog";
  type.options = with_common({
      {.name = "ip",
       .default_value = "127.0.0.1",
       .help = "the peer's address or name; with listen the own address, * for all",
       .value_name = "HOST"},
      {"port", Kind::integer, "20000", "the port's number; with listen 0 takes a free one and prints it", 0,
       kMaxPort},
      {"listen", Kind::flag, "", "the peer connects (tcp-listen:)"},
      kWait,
      kMaxConnections,
  });
  type.read = reads(tcp_options);
  type.make = makes<TcpOptions>([](const auto& context, const auto& common, const auto& options) {
    return std::make_unique<TcpPort>(context, common, options);
  });
  type.claims = [](const PortSpec& spec) {
    const TcpOptions& tcp = *spec.get<TcpOptions>();
    return tcp.stream.listen ? claim_address("TCP port", tcp.host, tcp.port) : Claims();
  };
  return type;
}

PortType udp_type() {
  PortType type{"udp", {"dest_ip", "dest_port"}, "UDP datagrams"};
  type.listening = {"recv_ip", "recv_port"};
  type.recorded_as = "udplog";
  type.keeps_datagrams = true;
  type.options = with_common({
      {.name = "dest_ip",
       .default_value = "127.0.0.1",
       .help = "address or name that datagrams go to",
       .value_name = "HOST"},
      {"dest_port", Kind::integer, "20000", "port that datagrams go to", 1, kMaxPort},
      {.name = "recv_ip",
       .default_value = "*",
       .help = "own address, * for all; with listen 127.0.0.1 unless given",
       .value_name = "HOST"},
      {"recv_port", Kind::integer, "20000", "own port; 0 takes a free one and prints it", 0, kMaxPort},
      {"listen", Kind::flag, "", "datagrams go to who sent the latest one (udp-listen:)"},
      {"from",
       Kind::choice,
       "",
       "whose datagrams count: the peer's or anybody's; peer unless given, any with listen and in a "
       "program's own ports",
       0,
       0,
       {"peer", "any"}},
  });
  type.complete = [](PortOptions& written) {
    if (written.flag("listen")) written.values.try_emplace("recv_ip", "127.0.0.1");
  };
  type.read = reads(udp_options);
  type.make = makes<UdpOptions>([](const auto& context, const auto& common, const auto& options) {
    return std::make_unique<UdpPort>(context, common, options);
  });
  type.claims = [](const PortSpec& spec) {
    const UdpOptions& udp = *spec.get<UdpOptions>();
    return claim_address("UDP port", udp.own_host, udp.own_port);
  };
  return type;
}

PortType unix_type() {
  PortType type{"unix", {"path"}, "a Unix stream socket"};
  type.listening = {"path"};
  type.recorded_as = "unixlog";
  type.options = with_common({
      {.name = "path", .help = "the socket's file", .value_name = "PATH"},
      {"listen", Kind::flag, "", "the peer connects (unix-listen:)"},
      {.name = "mode",
       .default_value = "0600",
       .help = "with listen, who may connect: permissions, octal",
       .value_name = "MODE"},
      kWait,
      kMaxConnections,
  });
  type.read = reads(unix_options);
  type.make = makes<UnixOptions>([](const auto& context, const auto& common, const auto& options) {
    return std::make_unique<UnixPort>(context, common, options);
  });
  type.claims = [](const PortSpec& spec) {
    const UnixOptions& options = *spec.get<UnixOptions>();
    return options.stream.listen ? Claims{{"socket", options.path}} : Claims();
  };
  return type;
}

}  // namespace porttape
