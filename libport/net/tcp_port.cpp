#include "libport/net/tcp_port.hpp"

#include <cerrno>
#include <fmt/format.h>
#include <iostream>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <vector>

#include <spdlog/spdlog.h>

#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

// A peer that has vanished without a word is noticed after a minute and a half.
constexpr int kKeepIdle = 60;  // s
constexpr int kKeepInterval = 10;
constexpr int kKeepCount = 3;

void set(int fd, int level, int option, int value) {
  (void)::setsockopt(fd, level, option, &value, sizeof value);
}

Result<std::vector<SocketAddress>> addresses_to_bind(const std::string& host, std::uint16_t port) {
  if (host == "*" || host.empty()) return any_addresses(port);
  return resolve(host, port);
}

// The socket, or the errno.
std::pair<UniqueFd, int> listener_at(const SocketAddress& address) {
  UniqueFd fd(::socket(address.family(), SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd) return {UniqueFd(), errno};
  set(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  if (address.family() == AF_INET6) set(fd.get(), IPPROTO_IPV6, IPV6_V6ONLY, 0);
  if (::bind(fd.get(), address.get(), address.size) != 0 || ::listen(fd.get(), StreamListener::kBacklog) != 0)
    return {UniqueFd(), errno};
  return {std::move(fd), 0};
}

const char* listen_advice(int error_number) {
  switch (error_number) {
    case EADDRINUSE:
      return "another program listens there; choose another port";
    case EACCES:
      return "ports below 1024 need CAP_NET_BIND_SERVICE; choose another port";
    case EADDRNOTAVAIL:
      return "this machine has no such address";
    default:
      return "check the address";
  }
}

}  // namespace

TcpPort::TcpPort(const PortContext& context, const CommonOptions& common, TcpOptions options)
    : StreamPort(context, common, options.stream), options_(std::move(options)) {}

TcpPort::TcpPort(const PortContext& context, const CommonOptions& common, TcpOptions options, UniqueFd given)
    : StreamPort(context, common, {}, std::move(given)), options_(std::move(options)) {}

std::unique_ptr<StreamPort> TcpPort::port_of(UniqueFd connection) {
  return std::make_unique<TcpPort>(context_, common_of_connections(), options_, std::move(connection));
}

std::string TcpPort::name() const {
  return (is_called() ? "tcp-listen:" : "tcp:") + host_and_port(options_.host, options_.port);
}

PortPlace TcpPort::place() const {
  return passive() ? bound_ : PortPlace{.host = options_.host, .port = options_.port};
}

Result<UniqueFd> TcpPort::make_listener() {
  const std::string& host = options_.host;
  const Result<std::vector<SocketAddress>> addresses = addresses_to_bind(host, options_.port);
  if (!addresses) return make_error(Errc::usage, fmt::format("option 'ip': {}", addresses.error().message));
  int error = 0;
  for (const SocketAddress& address : *addresses) {
    auto [fd, failure] = listener_at(address);
    if (fd) {
      const SocketAddress bound = local_address(fd.get());
      context_.log->info("listening on {}", bound.text());
      if (options_.port == 0) {
        if (context_.announces) std::cout << bound.text() << std::endl;
        options_.port = bound.port();
      }
      bound_ = place_bound_at(bound);
      return std::move(fd);
    }
    error = failure;
    if (error == EADDRINUSE) break;
  }
  return make_error(Errc::usage,
                    fmt::format("cannot listen on {}: {}; {}", host_and_port(host, options_.port),
                                errno_text(error), listen_advice(error)));
}

void TcpPort::connect_to_peer(Connector& connector) { connector.to_host(options_.host, options_.port); }

void TcpPort::set_up(int fd) {
  set(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  set(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
  set(fd, IPPROTO_TCP, TCP_KEEPIDLE, kKeepIdle);
  set(fd, IPPROTO_TCP, TCP_KEEPINTVL, kKeepInterval);
  set(fd, IPPROTO_TCP, TCP_KEEPCNT, kKeepCount);
}

}  // namespace porttape
