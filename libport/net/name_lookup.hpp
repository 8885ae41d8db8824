#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/loop/loop.hpp"
#include "libport/net/socket_address.hpp"

namespace porttape {

// Resolves a host name on one of the loop's other threads, so that a slow name server stops nobody: the loop
// goes on, and destroying the lookup does not wait for it. The callback comes once, from the loop, and may
// destroy the lookup. Loop thread only.
class NameLookup {
 public:
  using Callback = std::function<void(const Result<std::vector<SocketAddress>>&)>;

  NameLookup(Loop& loop, const std::string& host, std::uint16_t port, Callback callback);
  ~NameLookup();
  NameLookup(const NameLookup&) = delete;
  NameLookup& operator=(const NameLookup&) = delete;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
