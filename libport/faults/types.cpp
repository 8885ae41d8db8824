#include "libport/faults/types.hpp"

#include <memory>
#include <random>
#include <string>
#include <utility>

#include "libport/faults/fault_port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kLargestSeed = 9'007'199'254'740'991;  // 2^53 - 1, a whole number anywhere

// One a program, so that an option that is read twice is the same.
std::uint64_t seed_of_program() {
  static const std::uint64_t seed = std::random_device{}() % 1'000'000'000;
  return seed;
}

Result<FaultPlan> plan_of(const PortOptions& written, std::optional<LineDir> dir) {
  Result<FaultPlan> plan = load_fault_plan(written.text("faults"), dir);
  if (!plan) return make_error(Errc::usage, "option 'faults': " + plan.error().message);
  return plan;
}

Result<std::optional<FaultOptions>> read_options(const PortOptions& written, std::optional<LineDir> dir) {
  if (!written.has("faults")) {
    if (!written.has("seed")) return std::optional<FaultOptions>();
    return make_error(Errc::usage,
                      "option 'seed' is that of faults, and there are none; accepted: with faults");
  }
  Result<FaultPlan> plan = plan_of(written, dir);
  if (!plan) return plan.error();
  return std::optional(FaultOptions{.plan = std::move(*plan),
                                    .seed = static_cast<std::uint64_t>(written.number("seed")),
                                    .always_open = written.flag("alwaysopen"),
                                    .waits = written.flag("wait")});
}

// What a tape's header and messages tell is then enough to make the same faults again.
void complete(PortOptions& written, std::optional<LineDir> dir) {
  if (!written.has("faults")) return;
  if (const Result<FaultPlan> plan = plan_of(written, dir)) written.values["faults"] = plan->text();
  written.values.try_emplace("seed", std::to_string(seed_of_program()));
}

}  // namespace

std::vector<OptionSpec> fault_options() {
  return {
      {.name = "faults",
       .help = "damage to the line: KIND[:key=value…][;…] or a file of such lines, e.g. drop:p=0.01; kinds: "
               "drop, corrupt, duplicate, delay, stall, truncate, hangup, replug",
       .value_name = "FILE|SPEC"},
      {.name = "seed",
       .kind = OptionSpec::Kind::integer,
       .help = "of the faults: the same one makes the same damage; else one is drawn and told",
       .max = static_cast<double>(kLargestSeed)}};
}

PortType with_faults(PortType type, std::optional<LineDir> dir) {
  type.complete = [plain = std::move(type.complete), dir](PortOptions& written) {
    if (plain) plain(written);
    complete(written, dir);
  };
  return wrapped<FaultOptions>(
      std::move(type), fault_options(),
      [dir](const PortOptions& written) { return read_options(written, dir); },
      [](const PortContext& context, std::unique_ptr<Port> port, const FaultOptions& own) {
        return std::make_unique<FaultPort>(context, std::move(port), own);
      });
}

}  // namespace porttape
