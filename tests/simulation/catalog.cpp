#include "tests/simulation/catalog.hpp"

#include <map>
#include <utility>

#include "libport/catalog/port_types.hpp"
#include "libport/faults/types.hpp"
#include "libport/taped/types.hpp"
#include "tests/simulation/checked_port.hpp"
#include "tests/simulation/line_port.hpp"

namespace porttape {
namespace simulation {
namespace {

struct MemoryOptions {
  std::string line;
  bool listens = false;
};

struct PutUp {
  World* world;
  Line* line;
  Hall* hall;  // if not null
};
std::map<std::string, PutUp> lines;

Result<MemoryOptions> memory_options(const PortOptions& written) {
  const std::string name = written.text("line");
  if (!lines.contains(name)) return make_error(Errc::usage, "there is no line " + name);
  return MemoryOptions{name, written.flag("listen")};
}

PortType memory_type() {
  PortType type{"memory", {"line"}, "a line of the simulated world"};
  type.options = with_common({{"line", OptionSpec::Kind::text, "", "its name"},
                              {"listen", OptionSpec::Kind::flag, "", "drivers connect to it"}});
  type.recorded_as = "memorylog";
  type.read = reads(memory_options);
  type.make = [](const PortContext&, const PortSpec& spec,
                 const std::string&) -> Result<std::unique_ptr<Port>> {
    const MemoryOptions& options = *spec.get<MemoryOptions>();
    const PutUp& found = lines.at(options.line);
    if (options.listens) return found.hall->make_port();
    if (found.hall != nullptr) return std::make_unique<LinePort>(*found.world, found.hall->next_device());
    return std::make_unique<LinePort>(*found.world, *found.line);
  };
  return type;
}

// The outermost of a port's wrappers.
PortType checked(PortType type) {
  type.make = [plain = std::move(type.make)](const PortContext& context, const PortSpec& spec,
                                             const std::string& peer) {
    Result<std::unique_ptr<Port>> port = plain(context, spec, peer);
    const bool faults = spec.written().has("faults");
    if (port) *port = std::make_unique<CheckedPort>(*lines.begin()->second.world, std::move(*port), faults);
    return port;
  };
  return type;
}

}  // namespace

static PortTypes all_types() {
  const PortType memory = with_faults(memory_type());
  return PortTypes(
      {checked(memory), checked(recording_type(memory)), checked(with_faults(logreader_type(), LineDir::r))});
}

void put_up(World& world, Line& line) { lines.insert_or_assign(line.name(), PutUp{&world, &line, nullptr}); }
void put_up(World& world, Hall& hall) { lines.insert_or_assign(hall.name(), PutUp{&world, nullptr, &hall}); }
void take_down_lines() { lines.clear(); }

}  // namespace simulation

// What catalog/port_types.hpp declares.
const PortTypes& port_types() {
  static const PortTypes types = simulation::all_types();
  return types;
}

}  // namespace porttape
