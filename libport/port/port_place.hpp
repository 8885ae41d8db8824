#pragma once

#include <cstdint>
#include <string>

namespace porttape {

// Where a program finds a port: the file that it opens, or the address that it connects to.
struct PortPlace {
  std::string path = {};   // of a tty or a Unix socket; empty for an address
  std::string host = {};   // without brackets
  std::uint16_t port = 0;  // of an address
  std::string node =
      {};  // the device node that the peer opens (a pty's slave, `/dev/pts/3`); empty: there is none

  // The path, or `HOST:PORT`.
  [[nodiscard]] std::string text() const;

  friend bool operator==(const PortPlace&, const PortPlace&) = default;
};

}  // namespace porttape
