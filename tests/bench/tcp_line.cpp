#include "tests/bench/tcp_line.hpp"

#include <arpa/inet.h>
#include <cerrno>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/bench/line.hpp"

namespace porttape::bench {
namespace {

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

UniqueFd tcp_socket() {
  UniqueFd fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!fd) throw_errno("socket");
  return fd;
}

void set_nodelay(int fd) {
  const int on = 1;
  (void)::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

}  // namespace

UniqueFd listen_tcp() {
  UniqueFd fd = tcp_socket();
  const sockaddr_in address = loopback(0);
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(fd.get(), 16) != 0)
    throw_errno("listen");
  return fd;
}

std::uint16_t tcp_port(int fd) {
  sockaddr_in address{};
  socklen_t size = sizeof address;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) throw_errno("getsockname");
  return ntohs(address.sin_port);
}

// Below the ports that the kernel gives away by itself, and never the same twice in a row.
std::uint16_t free_tcp_port() {
  constexpr int kFirst = 12000;
  constexpr int kCount = 20000;
  static int last = ::getpid() * 97 % kCount;
  for (;;) {
    last = (last + 1) % kCount;
    const auto port = static_cast<std::uint16_t>(kFirst + last);
    const UniqueFd fd = tcp_socket();
    const sockaddr_in address = loopback(port);
    if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return port;
  }
}

UniqueFd accept_tcp(int listener) {
  for (;;) {
    UniqueFd fd(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC));
    if (!fd && errno != EINTR) throw_errno("accept");
    check_signals();
    if (!fd) continue;
    set_nodelay(fd.get());
    return fd;
  }
}

UniqueFd connect_tcp(std::uint16_t port, int limit_ms) {
  const sockaddr_in address = loopback(port);
  for (int waited = 0;; waited += 2) {
    UniqueFd fd = tcp_socket();
    if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
      set_nodelay(fd.get());
      return fd;
    }
    if (errno != ECONNREFUSED || waited >= limit_ms) throw_errno("connect");
    sleep_ms(2);
  }
}

}  // namespace porttape::bench
