#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <sys/socket.h>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port_place.hpp"

namespace porttape {

// Where a socket is bound or connected: IPv4, IPv6 or a Unix path.
struct SocketAddress {
  sockaddr_storage storage{};
  socklen_t size = 0;

  [[nodiscard]] const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }
  [[nodiscard]] int family() const { return storage.ss_family; }
  // 0 for Unix paths.
  [[nodiscard]] std::uint16_t port() const;
  // `127.0.0.1`, `::1`; `?` for Unix paths.
  [[nodiscard]] std::string host() const;
  // `127.0.0.1:2112`, `[::1]:2112`, `/run/x`.
  [[nodiscard]] std::string text() const;
};

// Whether two addresses of the internet are one, whatever else (flow, scope) comes with them.
bool same_host_and_port(const SocketAddress& one, const SocketAddress& other);

// Every address of a host, in the system's order. May wait for a name server: NameLookup does it off the
// loop. The error text tells which name did not resolve.
Result<std::vector<SocketAddress>> resolve(const std::string& host, std::uint16_t port);
// An address that needs no name server; nothing for a name.
std::optional<SocketAddress> numeric_address(const std::string& host, std::uint16_t port);
// The wildcard addresses, best first: `::`, which takes IPv4 too, then `0.0.0.0`.
std::vector<SocketAddress> any_addresses(std::uint16_t port);
// Errc::usage for a path that is too long (107 bytes at most).
Result<SocketAddress> unix_address(const std::string& path);

// Where a program of this machine reaches what is bound there.
PortPlace place_bound_at(const SocketAddress& address);

SocketAddress local_address(int fd);
SocketAddress peer_address(int fd);

}  // namespace porttape
