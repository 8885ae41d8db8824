#pragma once

#include <string_view>

namespace porttape {

// Tells systemd about our state ("READY=1"), by the protocol of sd_notify(3). Does nothing when not started
// by it.
void notify_systemd(std::string_view state);

}  // namespace porttape
