#pragma once

#include <optional>
#include <vector>

#include "libport/line/line_fault.hpp"
#include "libport/port/port_type.hpp"

namespace porttape {

// The options that ask for faults, as the verbs have them too.
std::vector<OptionSpec> fault_options();

// The type with faults on its ports (FaultPort). What of a plan says no direction has `dir`; none: both. In a
// port's options the plan stands as text, with its seed, whatever file it was in. Its struct of options is
// FaultOptions.
PortType with_faults(PortType type, std::optional<LineDir> dir = {});

}  // namespace porttape
