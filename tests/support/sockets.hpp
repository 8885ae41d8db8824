#pragma once

#include <array>
#include <cerrno>
#include <cstring>
#include <netinet/in.h>
#include <poll.h>
#include <stdexcept>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/net/socket_address.hpp"
#include "libport/port/port.hpp"

namespace porttape::test {

// The test's own end of a connection on the loopback interface. Never blocks.
class Socket {
 public:
  Socket() = default;
  explicit Socket(UniqueFd fd) : fd_(std::move(fd)) {}

  static Socket connect_to(const SocketAddress& address) {
    Socket socket(UniqueFd(::socket(address.family(), SOCK_STREAM | SOCK_CLOEXEC, 0)));
    if (::connect(socket.fd(), address.get(), address.size) != 0) throw std::runtime_error("connect failed");
    return socket;
  }
  static Socket connect_to(std::uint16_t port) { return connect_to(*numeric_address("127.0.0.1", port)); }
  // Has a free port and does not listen: connections are refused.
  static Socket bound() {
    const SocketAddress any = *numeric_address("127.0.0.1", 0);
    Socket socket(UniqueFd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)));
    if (::bind(socket.fd(), any.get(), any.size) != 0) throw std::runtime_error("bind failed");
    return socket;
  }
  static Socket listening(int backlog = 16) {
    Socket socket = bound();
    socket.listen(backlog);
    return socket;
  }
  void listen(int backlog = 16) const {
    if (::listen(fd(), backlog) != 0) throw std::runtime_error("listen failed");
  }
  static Socket datagrams() {
    const SocketAddress any = *numeric_address("127.0.0.1", 0);
    Socket socket(UniqueFd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)));
    if (::bind(socket.fd(), any.get(), any.size) != 0) throw std::runtime_error("bind failed");
    return socket;
  }

  [[nodiscard]] int fd() const { return fd_.get(); }
  [[nodiscard]] std::uint16_t port() const { return local_address(fd()).port(); }
  [[nodiscard]] bool readable() const {
    pollfd poll{fd(), POLLIN, 0};
    return ::poll(&poll, 1, 0) > 0;
  }
  [[nodiscard]] Socket accept() const {
    return Socket(UniqueFd(::accept4(fd(), nullptr, nullptr, SOCK_CLOEXEC)));
  }

  void send(std::string_view text) const {
    if (::send(fd(), text.data(), text.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(text.size()))
      throw std::runtime_error("send failed");
  }
  void send_to(std::uint16_t port, std::string_view text) const {
    const SocketAddress to = *numeric_address("127.0.0.1", port);
    if (::sendto(fd(), text.data(), text.size(), 0, to.get(), to.size) < 0)
      throw std::runtime_error("sendto failed");
  }
  // What is there now is added to `got`; the end and a reset are noted in `ended`: "", "end", "reset".
  void receive() {
    std::array<char, 65536> buffer{};
    while (ended.empty()) {
      const ssize_t size = ::recv(fd(), buffer.data(), buffer.size(), MSG_DONTWAIT);
      if (size > 0) got.append(buffer.data(), static_cast<std::size_t>(size));
      if (size == 0) ended = "end";
      if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
      if (size < 0) ended = "reset";
    }
  }
  void end_sending() const { (void)::shutdown(fd(), SHUT_WR); }
  void reset() {
    const linger at_once{1, 0};
    (void)::setsockopt(fd(), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    fd_.reset();
  }
  void close() { fd_.reset(); }

  std::string got;
  std::string ended;

 private:
  UniqueFd fd_;
};

// Prepares a port that has 0 for its number, and gives the number from the line that it prints, 0 on an
// error.
inline std::uint16_t prepare_any(Port& port) {
  testing::internal::CaptureStdout();
  const Result<void> prepared = port.prepare();
  const std::string printed = testing::internal::GetCapturedStdout();
  EXPECT_TRUE(prepared.has_value()) << (prepared ? "" : prepared.error().message);
  const std::size_t colon = printed.rfind(':');
  return prepared && colon != std::string::npos
             ? static_cast<std::uint16_t>(std::stoi(printed.substr(colon + 1)))
             : 0;
}

}  // namespace porttape::test
