#pragma once

#include "libport/port/stream_port.hpp"

namespace porttape {

// A TCP connection: to `ip`:`port`, or with `listen` from whoever connects there. Names and IPv6 addresses
// are as good as IPv4 ones; all addresses of a name are tried in the system's order. Listening without `ip`
// binds 127.0.0.1; `*` is every address. With port 0 the system chooses one, and prepare() prints
// `ADDRESS:PORT` on stdout.
class TcpPort final : public StreamPort {
 public:
  TcpPort(const PortContext& context, const PortOptions& options);

 protected:
  Result<UniqueFd> make_listener() override;
  void connect_to_peer(Connector& connector) override;
  void set_up(int fd) override;
  [[nodiscard]] PeerState peer_state(int fd) const override { return tcp_peer_state(fd); }

 private:
  [[nodiscard]] std::uint16_t port_number() const;
};

}  // namespace porttape
