#pragma once

#include "libport/base/unique_fd.hpp"

namespace porttape {

// Tells that the last program which had a pty's slave open has closed it. The kernel keeps this for a
// descriptor that is watched by edges: so an open that was over before anyone looked leaves a trace, unless
// another open is there by the time one looks, and several are one.
class LastClose {
 public:
  LastClose() = default;
  // Watches from now on. The master is borrowed. Where no descriptor is to be had, nothing is ever told.
  explicit LastClose(int master);

  // Whether it has happened since the last call. Our own closes count too, and so does a change of the flow
  // control by software that is made through the master of a pty in packet mode.
  bool take();

 private:
  UniqueFd epoll_;
};

}  // namespace porttape
