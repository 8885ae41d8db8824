#pragma once

namespace porttape {

// What a peer that has sent its last byte can still do.
enum class PeerState {
  gone,     // it has closed its socket: nobody will read an answer
  reading,  // it has only ended its sending direction (shutdown, half-close)
  remote,   // its end is on another machine, where the two look the same
  unknown   // the kernel did not tell
};

// Asks the kernel for the socket at the other end of a connected TCP socket, which it knows when that is on
// this machine and in this network namespace (sock_diag(7)).
PeerState tcp_peer_state(int fd);

}  // namespace porttape
