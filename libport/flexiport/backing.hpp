#pragma once

#include <atomic>
#include <flexiport/flexiport.h>
#include <flexiport/timeout.h>
#include <memory>
#include <string>

#include "libport/blocking/blocking_port.hpp"

namespace flexiport {

// Behind each port of this library.
struct Backing {
  std::unique_ptr<porttape::BlockingPort> port;
  std::map<std::string, std::string> options;  // of the port, until it is made
  std::atomic<bool> opened_by_option = false;  // alwaysopen: the first Open() finds it open
  bool other = false;                          // of a type that flexiport has no class for
};

inline porttape::Micros to_micros(const Timeout& timeout) {
  if (timeout._sec < 0) return porttape::BlockingPort::kForever;
  return std::chrono::seconds(timeout._sec) + porttape::Micros(timeout._usec);
}

[[noreturn]] inline void raise(const porttape::Error& error) { throw PortException(error.message); }

}  // namespace flexiport
