#include "libport/faults/fault_plan.hpp"

#include <fmt/format.h>

#include "libport/faults/fault_keys.hpp"

namespace porttape {

std::string_view to_string(Fault::Kind kind) { return kFaultKinds.at(static_cast<std::size_t>(kind)); }

std::string to_text(const Fault& fault) {
  std::string text(to_string(fault.kind));
  for (const FaultKey& key : fault_keys()) {
    if (!key.takes(fault.kind)) continue;
    if (const std::string value = key.write(fault); !value.empty())
      text += fmt::format(":{}={}", key.name, value);
  }
  return text;
}

std::string FaultPlan::text() const {
  std::string text;
  for (const Fault& fault : faults) text += (text.empty() ? "" : ";") + to_text(fault);
  return text;
}

}  // namespace porttape
