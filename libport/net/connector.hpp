#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/timer.hpp"
#include "libport/net/name_lookup.hpp"
#include "libport/net/socket_address.hpp"

namespace porttape {

// Connects a stream socket to the first of several addresses that answers. `limit` is for the whole of it,
// the name lookup included; of what is left each address has an equal share, so that one that swallows
// packets does not keep the next from its turn.
//
// Calls back once, from the loop, with the connected socket (non-blocking, close-on-exec) or with
// Errc::device_missing and why. The callback may destroy the connector. Loop thread only.
class Connector {
 public:
  using Callback = std::function<void(Result<UniqueFd>)>;

  Connector(Loop& loop, Nanos limit, Callback callback);

  // One of these, once.
  void to_host(const std::string& host, std::uint16_t port);
  void to_address(const SocketAddress& address);

 private:
  void next_address();
  void attempt(const SocketAddress& address);
  void attempt_ended(int error_number);
  void on_timer();
  void end(Result<UniqueFd> result);

  Loop* loop_;
  Callback callback_;
  Instant deadline_;
  Timer timer_;
  std::unique_ptr<NameLookup> lookup_;
  std::vector<SocketAddress> addresses_;
  std::size_t next_ = 0;
  UniqueFd fd_;
  std::unique_ptr<FdWatch> watch_;
  std::string target_;
  std::string failures_;  // of the addresses tried, for the message
};

}  // namespace porttape
