#include "libport/net/tcp_peer.hpp"

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "libport/base/unique_fd.hpp"
#include "libport/net/socket_address.hpp"

namespace porttape {
namespace {

struct Query {
  nlmsghdr header{};
  inet_diag_req_v2 request{};
};

// Ports and addresses as the kernel wants them: network order, IPv4 in the first word.
void put(const SocketAddress& address, std::uint16_t& port, std::uint32_t (&words)[4]) {
  if (address.family() == AF_INET) {
    sockaddr_in four{};
    std::memcpy(&four, &address.storage, sizeof four);
    port = four.sin_port;
    words[0] = four.sin_addr.s_addr;
  } else {
    sockaddr_in6 six{};
    std::memcpy(&six, &address.storage, sizeof six);
    port = six.sin6_port;
    std::memcpy(&words, &six.sin6_addr, sizeof words);
  }
}

Query query_for(const SocketAddress& local, const SocketAddress& remote) {
  Query query;
  query.header.nlmsg_len = sizeof query;
  query.header.nlmsg_type = SOCK_DIAG_BY_FAMILY;
  query.header.nlmsg_flags = NLM_F_REQUEST;
  query.request.sdiag_family = static_cast<std::uint8_t>(local.family());
  query.request.sdiag_protocol = IPPROTO_TCP;
  query.request.idiag_states = ~0U;
  put(remote, query.request.id.idiag_sport, query.request.id.idiag_src);  // as its owner sees it
  put(local, query.request.id.idiag_dport, query.request.id.idiag_dst);
  for (auto& word : query.request.id.idiag_cookie) word = INET_DIAG_NOCOOKIE;
  return query;
}

}  // namespace

PeerState tcp_peer_state(int fd) {
  const SocketAddress local = local_address(fd);
  const SocketAddress remote = peer_address(fd);
  if (local.family() != AF_INET && local.family() != AF_INET6) return PeerState::unknown;
  if (remote.family() != local.family()) return PeerState::unknown;
  const UniqueFd netlink(::socket(AF_NETLINK, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, NETLINK_SOCK_DIAG));
  const Query query = query_for(local, remote);
  if (!netlink || ::send(netlink.get(), &query, sizeof query, 0) != sizeof query) return PeerState::unknown;
  // The kernel answers within send().
  std::array<char, 4096> answer{};
  const ssize_t size = ::recv(netlink.get(), answer.data(), answer.size(), 0);
  nlmsghdr header{};
  inet_diag_msg message{};
  if (size < static_cast<ssize_t>(NLMSG_HDRLEN + sizeof(nlmsgerr))) return PeerState::unknown;
  std::memcpy(&header, answer.data(), sizeof header);
  if (header.nlmsg_type == NLMSG_ERROR) {
    nlmsgerr error{};
    std::memcpy(&error, answer.data() + NLMSG_HDRLEN, sizeof error);
    return error.error == -ENOENT ? PeerState::remote : PeerState::unknown;
  }
  if (header.nlmsg_type != SOCK_DIAG_BY_FAMILY) return PeerState::unknown;
  if (size < static_cast<ssize_t>(NLMSG_HDRLEN + sizeof message)) return PeerState::unknown;
  std::memcpy(&message, answer.data() + NLMSG_HDRLEN, sizeof message);
  return message.idiag_inode == 0 ? PeerState::gone : PeerState::reading;  // no inode: no program has it
}

}  // namespace porttape
