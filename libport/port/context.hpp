#pragma once

#include <memory>

#include <spdlog/fwd.h>

#include "libport/loop/loop.hpp"

namespace porttape {

class Disks;
class ReplayClock;

// What every port needs from its program.
struct PortContext {
  Loop* loop = nullptr;  // outlives the ports
  std::shared_ptr<spdlog::logger> log;
  std::shared_ptr<Disks> disks = {};  // of the program, for its tapes; none: each tape learns for itself
  std::shared_ptr<ReplayClock> replay_clock = {};  // that its tapes are played by; none: each has its own
  bool pulled = false;                             // the loop only runs while its program waits in a call
  bool announces = true;                           // ports whose place the system chooses print it on stdout
};

}  // namespace porttape
