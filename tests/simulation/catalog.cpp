#include "tests/simulation/catalog.hpp"

#include <map>
#include <utility>

#include "libport/catalog/port_types.hpp"
#include "libport/faults/types.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace simulation {
namespace {

struct MemoryOptions {
  std::string line;
};

struct PutUp {
  World* world;
  Line* line;
};
std::map<std::string, PutUp> lines;

Result<MemoryOptions> memory_options(const PortOptions& written) {
  const std::string name = written.text("line");
  if (!lines.contains(name)) return make_error(Errc::usage, "there is no line " + name);
  return MemoryOptions{name};
}

PortType memory_type() {
  PortType type{"memory", {"line"}, "a line of the simulated world"};
  type.options = with_common({{"line", OptionSpec::Kind::text, "", "its name"}});
  type.recorded_as = "memorylog";
  type.read = reads(memory_options);
  type.make = [](const PortContext&, const PortSpec& spec,
                 const std::string&) -> Result<std::unique_ptr<Port>> {
    const PutUp& found = lines.at(spec.get<MemoryOptions>()->line);
    return std::make_unique<LinePort>(*found.world, *found.line);
  };
  return type;
}

}  // namespace

void put_up(World& world, Line& line) { lines.insert_or_assign(line.name(), PutUp{&world, &line}); }
void take_down_lines() { lines.clear(); }

}  // namespace simulation

// What catalog/port_types.hpp declares.
const PortTypes& port_types() {
  static const PortType memory = with_faults(simulation::memory_type());
  static const PortTypes types({memory, recording_type(memory), with_faults(logreader_type(), LineDir::r)});
  return types;
}

}  // namespace porttape
