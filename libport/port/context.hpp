#pragma once

#include <memory>

#include <spdlog/logger.h>

#include "libport/port/loop.hpp"
#include "libport/tape/live_tape.hpp"

namespace porttape {

// What every port needs from its program.
struct PortContext {
  Loop* loop = nullptr;  // outlives the ports
  std::shared_ptr<spdlog::logger> log;
  std::shared_ptr<Disks> disks = std::make_shared<Disks>();  // shared by the channels of a program
  bool pulled = false;  // the loop only runs while its program waits in a call
};

}  // namespace porttape
