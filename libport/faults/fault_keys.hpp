#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

#include "libport/faults/fault_plan.hpp"

namespace porttape {

// The names of Fault::Kind, in its order.
inline constexpr std::array<std::string_view, 8> kFaultKinds = {"drop",  "corrupt",  "duplicate", "delay",
                                                                "stall", "truncate", "hangup",    "replug"};

// A key of a fault's text: whose it is, how it is read and written.
struct FaultKey {
  std::string_view name;
  std::string_view kinds;     // their first letters (d: drop, c, u: duplicate, y: delay, s, t, h, r)
  std::string_view accepted;  // for messages
  bool (*read)(Fault& fault, std::string_view value);  // false: the value is not one of these
  std::string (*write)(const Fault& fault);            // empty: it says nothing

  [[nodiscard]] bool takes(Fault::Kind kind) const {
    return kinds.find("dcuysthr"[static_cast<std::size_t>(kind)]) != std::string_view::npos;
  }
};

// In the order in which they are written.
std::span<const FaultKey> fault_keys();

}  // namespace porttape
