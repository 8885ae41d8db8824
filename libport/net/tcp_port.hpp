#pragma once

#include <cstdint>
#include <string>

#include "libport/net/stream_port.hpp"

namespace porttape {

struct TcpOptions {
  std::string host = "127.0.0.1";  // of the peer; with listen the own one, `*` for all
  std::uint16_t port = 20000;
  StreamOptions stream = {};
};

// A TCP connection: to `ip`:`port`, or with `listen` from whoever connects there. Names and IPv6 addresses
// are as good as IPv4 ones; all addresses of a name are tried in the system's order. Listening without `ip`
// binds 127.0.0.1; `*` is every address. With port 0 the system chooses one, and prepare() prints
// `ADDRESS:PORT` on stdout where the context announces.
class TcpPort final : public StreamPort {
 public:
  TcpPort(const PortContext& context, const CommonOptions& common, TcpOptions options);
  // Of a connection that a port with these options has accepted.
  TcpPort(const PortContext& context, const CommonOptions& common, TcpOptions options, UniqueFd given);

  [[nodiscard]] std::string name() const override;
  [[nodiscard]] PortPlace place() const override;

 protected:
  Result<UniqueFd> make_listener() override;
  void connect_to_peer(Connector& connector) override;
  void set_up(int fd) override;
  std::unique_ptr<StreamPort> port_of(UniqueFd connection) override;
  [[nodiscard]] PeerState peer_state(int fd) const override { return tcp_peer_state(fd); }

 private:
  TcpOptions options_;
  PortPlace bound_;  // listening
};

}  // namespace porttape
