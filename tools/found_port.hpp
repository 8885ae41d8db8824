#pragma once

#include <optional>

#include <spdlog/fwd.h>

#include "libport/port/port.hpp"
#include "libport/supervise/device_view.hpp"
#include "tools/supervision.hpp"

namespace porttape {

// The port as a supervised command is to find it: as the user has it, else as its device (`device`, or null)
// or its tape knows it. Nothing where it has no identity, where the user wants none, or where this machine
// forbids it, which is told.
std::optional<DevicePort> port_to_find(const Supervision& supervision, const Port& driver, const Port* device,
                                       spdlog::logger& log);

}  // namespace porttape
