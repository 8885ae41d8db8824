#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "libport/replay/report.hpp"

namespace porttape {

// The exchanges around a report's fault: indexes of its excerpt's steps. Plain value.
struct Neighbours {
  std::optional<std::size_t> previous;
  std::optional<std::size_t> next;
};

// Of a report with an excerpt.
Neighbours neighbours_of(const RunReport& report);
// How much of the answer that ends the step had been delivered when the fault showed.
std::uint64_t delivered_of(const RunReport& report, const TapeAnswer& answer);

// The same for a person: what was asked, what was answered, and how much of that came in this run.
struct Context {
  std::optional<std::string> previous;
  std::optional<std::string> next;
};
Context context_of(const RunReport& report);

}  // namespace porttape
