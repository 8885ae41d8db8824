#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/port_identity.hpp"
#include "libport/base/result.hpp"
#include "libport/base/tty_device.hpp"
#include "libport/port/port_type.hpp"
#include "libport/supervise/line_model.hpp"
#include "libport/supervise/tapped_line.hpp"

namespace porttape {

// How a command is supervised (`porttape exec`, and --exec of other verbs).
struct Supervision {
  LineDefaults lines = {};
  bool finds = true;  // the command its port, by the identity of device or tape; see port_to_find()
  std::optional<PortIdentity> as = {};  // or by this
  // It keeps its own device, which is told here; null: it has the driver's port.
  std::shared_ptr<TappedLine> tapped = {};
  std::optional<TtyDevice> tapped_device = {};  // none: the first that it opens
};

// --lines, --as; with `flag` also --exec, without which they count for nothing.
std::vector<OptionSpec> supervision_options(bool flag);

// Takes these options out of `values`; nothing without --exec where that is an option. Errc::usage names the
// one that is wrong.
Result<std::optional<Supervision>> take_supervision(std::map<std::string, std::string>& values, bool flag);

}  // namespace porttape
