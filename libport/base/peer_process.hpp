#pragma once

#include <optional>
#include <sys/socket.h>

namespace porttape {

// The process at the other end of a connected AF_UNIX socket, as the kernel knew it when it connected or
// began to listen (unix(7), SO_PEERCRED); its pid is 0 in a PID namespace that does not show it. std::nullopt
// where the kernel does not tell it; errno has the reason.
std::optional<ucred> peer_process(int fd);

}  // namespace porttape
