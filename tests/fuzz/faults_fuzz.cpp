// Any text as a plan of faults: no crash, errors that a user can act on; what was understood can be written
// down and understood again, and does the same to a stream of bytes however that is cut into arrivals.

#include <string>

#include "libport/faults/fault_plan.hpp"
#include "libport/faults/fault_stream.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/usage_error.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

constexpr Instant kNow{std::chrono::hours(1)};

struct Made {
  std::string bytes;
  std::string specs;
};

// Up to where the line breaks.
Made made_of(const FaultPlan& plan, std::string_view text, std::size_t piece, Nanos elapsed) {
  FaultStream stream(plan, 1, LineDir::r, false);
  Made made;
  for (std::size_t at = 0; at < text.size(); at += piece) {
    const std::string_view arrival = text.substr(at, piece);
    const FaultStream::Outcome outcome = stream.take(as_bytes(arrival), kNow, kNow - elapsed);
    if (outcome.untouched) made.bytes += arrival;
    for (const FaultStream::Piece& each : outcome.pieces) made.bytes += as_text(each.data);
    for (const LineFault& fault : outcome.faults) made.specs += fault.spec.raw() + ";";
    if (outcome.broken != nullptr) break;
  }
  return made;
}

// Told in the plan's order, of one arrival; a strike of several arrivals is told where it begins.
bool same(const Made& whole, const Made& cut) {
  return whole.bytes == cut.bytes && whole.specs.size() == cut.specs.size();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  const std::size_t piece = 1 + input(7);
  const Nanos elapsed = std::chrono::seconds(input(20));
  const std::string_view text = input.rest();
  const Result<FaultPlan> plan = parse_fault_plan(text, LineDir::r);
  if (!plan) {
    require_usage(plan.error());
    return 0;
  }
  const std::string written = plan->text();
  const Result<FaultPlan> again = parse_fault_plan(written, {});
  require(again && *again == *plan, "a plan is understood as it was written down");
  require(written.find_first_of(", \t\n") == std::string::npos, "it can stand behind a port");
  const std::string_view stream = text.substr(0, 300);
  require(same(made_of(*plan, stream, 300, elapsed), made_of(*plan, stream, piece, elapsed)),
          "it does not matter how bytes arrive");
  return 0;
}
