#pragma once

#include <cstdint>

#include "libport/base/unique_fd.hpp"

// Ends of TCP lines on 127.0.0.1, all with TCP_NODELAY.
namespace porttape::bench {

// Listening on a port that the system chooses.
UniqueFd listen_tcp();
std::uint16_t tcp_port(int fd);
// A port that nobody listens on.
std::uint16_t free_tcp_port();

UniqueFd accept_tcp(int listener);
// Tries again while nobody listens there yet, until `limit_ms` have passed.
UniqueFd connect_tcp(std::uint16_t port, int limit_ms);

}  // namespace porttape::bench
