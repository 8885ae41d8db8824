#include "libport/net/socket_address.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cstddef>
#include <cstring>
#include <fmt/format.h>
#include <memory>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/un.h>

#include "libport/base/printable.hpp"
#include "libport/port/spelling.hpp"

namespace porttape {
namespace {

template <class T>
T as(const sockaddr_storage& storage) {
  T address{};
  std::memcpy(&address, &storage, sizeof address);
  return address;
}

SocketAddress copy_of(const void* address, std::size_t size) {
  SocketAddress copy;
  copy.size = static_cast<socklen_t>(size);
  std::memcpy(&copy.storage, address, size);
  return copy;
}

using AddressList = std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)>;

// The status is getaddrinfo's.
std::pair<AddressList, int> look_up(const std::string& host, std::uint16_t port, int flags) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;  // else each address comes once for each kind of socket
  hints.ai_flags = flags | AI_NUMERICSERV;
  addrinfo* list = nullptr;
  const int status = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &list);
  return {AddressList(status == 0 ? list : nullptr, &::freeaddrinfo), status};
}

}  // namespace

std::uint16_t SocketAddress::port() const {
  if (family() == AF_INET) return ntohs(as<sockaddr_in>(storage).sin_port);
  if (family() == AF_INET6) return ntohs(as<sockaddr_in6>(storage).sin6_port);
  return 0;
}

std::string SocketAddress::host() const {
  if (family() == AF_UNIX) return "?";  // getnameinfo() calls it localhost
  std::array<char, NI_MAXHOST> host{};
  if (::getnameinfo(get(), size, host.data(), host.size(), nullptr, 0, NI_NUMERICHOST) != 0) return "?";
  return host.data();
}

std::string SocketAddress::text() const {
  if (family() == AF_UNIX) {
    const auto address = as<sockaddr_un>(storage);
    return {address.sun_path, ::strnlen(address.sun_path, sizeof address.sun_path)};
  }
  return host_and_port(host(), port());
}

bool same_host_and_port(const SocketAddress& one, const SocketAddress& other) {
  if (one.family() != other.family() || one.port() != other.port()) return false;
  if (one.family() == AF_INET)
    return as<sockaddr_in>(one.storage).sin_addr.s_addr == as<sockaddr_in>(other.storage).sin_addr.s_addr;
  const auto six = as<sockaddr_in6>(one.storage).sin6_addr;
  const auto other_six = as<sockaddr_in6>(other.storage).sin6_addr;
  return one.family() == AF_INET6 && std::memcmp(&six, &other_six, sizeof six) == 0;
}

Result<std::vector<SocketAddress>> resolve(const std::string& host, std::uint16_t port) {
  const auto [list, status] = look_up(host, port, 0);
  std::vector<SocketAddress> addresses;
  for (const addrinfo* entry = list.get(); entry != nullptr; entry = entry->ai_next) {
    addresses.push_back(copy_of(entry->ai_addr, entry->ai_addrlen));
  }
  if (addresses.empty()) {
    return make_error(Errc::device_missing, fmt::format("the name {} does not resolve ({})", in_quotes(host),
                                                        ::gai_strerror(status == 0 ? EAI_NONAME : status)));
  }
  return addresses;
}

std::optional<SocketAddress> numeric_address(const std::string& host, std::uint16_t port) {
  const auto [list, status] = look_up(host, port, AI_NUMERICHOST);
  if (!list) return std::nullopt;
  return copy_of(list->ai_addr, list->ai_addrlen);
}

std::vector<SocketAddress> any_addresses(std::uint16_t port) {
  sockaddr_in6 six{};
  six.sin6_family = AF_INET6;
  six.sin6_port = htons(port);
  sockaddr_in four{};
  four.sin_family = AF_INET;
  four.sin_port = htons(port);
  return {copy_of(&six, sizeof six), copy_of(&four, sizeof four)};
}

Result<SocketAddress> unix_address(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) {
    return make_error(Errc::usage, fmt::format("option 'path': {} is {} bytes long; accepted: at most {}",
                                               in_quotes(path), path.size(), sizeof address.sun_path - 1));
  }
  std::copy(path.begin(), path.end(), address.sun_path);
  return copy_of(&address, offsetof(sockaddr_un, sun_path) + path.size() + 1);
}

PortPlace place_bound_at(const SocketAddress& address) {
  if (address.family() == AF_INET && as<sockaddr_in>(address.storage).sin_addr.s_addr == htonl(INADDR_ANY))
    return {.host = "127.0.0.1", .port = address.port()};
  // It takes IPv4 too.
  if (address.family() == AF_INET6) {
    const auto six = as<sockaddr_in6>(address.storage).sin6_addr;
    if (IN6_IS_ADDR_UNSPECIFIED(&six)) return {.host = "127.0.0.1", .port = address.port()};
  }
  return {.host = address.host(), .port = address.port()};
}

SocketAddress local_address(int fd) {
  SocketAddress address;
  address.size = sizeof address.storage;
  (void)::getsockname(fd, reinterpret_cast<sockaddr*>(&address.storage), &address.size);
  return address;
}

SocketAddress peer_address(int fd) {
  SocketAddress address;
  address.size = sizeof address.storage;
  (void)::getpeername(fd, reinterpret_cast<sockaddr*>(&address.storage), &address.size);
  return address;
}

}  // namespace porttape
