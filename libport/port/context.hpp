#pragma once

#include <memory>

#include <spdlog/logger.h>

#include "libport/loop/loop.hpp"

namespace porttape {

class Disks;

// What every port needs from its program.
struct PortContext {
  Loop* loop = nullptr;  // outlives the ports
  std::shared_ptr<spdlog::logger> log;
  std::shared_ptr<Disks> disks = {};  // of the program, for its tapes; none: each tape learns for itself
  bool pulled = false;                // the loop only runs while its program waits in a call
};

}  // namespace porttape
