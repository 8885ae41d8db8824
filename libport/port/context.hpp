#pragma once

#include <memory>

#include <spdlog/logger.h>

#include "libport/port/loop.hpp"

namespace porttape {

// What every port needs from its program.
struct PortContext {
  Loop* loop = nullptr;  // outlives the ports
  std::shared_ptr<spdlog::logger> log;
  bool pulled = false;  // the loop only runs while its program waits in a call
};

}  // namespace porttape
