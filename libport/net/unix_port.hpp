#pragma once

#include <optional>
#include <string>
#include <sys/types.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/net/stream_port.hpp"

namespace porttape {

struct UnixOptions {
  std::string path;
  unsigned mode = 0600;  // of the socket file, with listen
  StreamOptions stream = {};
};

// A Unix stream socket at `path`. With `listen` it makes the socket file, with the permissions `mode`, and
// takes it away at the end if it is still its own. It replaces nothing but a socket that nobody listens on,
// left by a program that was killed. A link of another user is never followed, neither in its place nor on
// the way.
class UnixPort final : public StreamPort {
 public:
  UnixPort(const PortContext& context, const CommonOptions& common, UnixOptions options);
  // Of a connection that a port with these options has accepted.
  UnixPort(const PortContext& context, const CommonOptions& common, UnixOptions options, UniqueFd given);
  ~UnixPort() override;

  [[nodiscard]] std::string name() const override { return (is_called() ? "unix-listen:" : "unix:") + path_; }
  [[nodiscard]] PortPlace place() const override { return {.path = path_}; }

 protected:
  Result<UniqueFd> make_listener() override;
  Result<void> check_peer() override;
  void connect_to_peer(Connector& connector) override;
  [[nodiscard]] PeerState peer_state(int fd) const override;
  std::unique_ptr<StreamPort> port_of(UniqueFd connection) override;

 private:
  [[nodiscard]] Result<void> free_place(const SocketAddress& address) const;
  Result<void> own_node();

  const std::string path_;
  const mode_t mode_;
  TrustedName place_;                 // of a socket file that is to be made
  std::optional<FileIdentity> node_;  // that we made
};

}  // namespace porttape
