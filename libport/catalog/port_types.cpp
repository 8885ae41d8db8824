#include "libport/catalog/port_types.hpp"

#include <utility>
#include <vector>

#include "libport/net/types.hpp"
#include "libport/taped/types.hpp"
#include "libport/tty/types.hpp"

namespace porttape {
namespace {

// A wrapper for all ports goes around each before those that record are made, so that it stands between the
// tape and the device.
std::vector<PortType> all_types() {
  std::vector<PortType> types = {serial_type(), pty_type(), logreader_type(),
                                 tcp_type(),    udp_type(), unix_type()};
  for (std::size_t n = 0, plain = types.size(); n < plain; ++n) {
    if (!types[n].recorded_as.empty()) types.push_back(recording_type(types[n]));
  }
  return types;
}

}  // namespace

const PortTypes& port_types() {
  static const PortTypes types(all_types());
  return types;
}

}  // namespace porttape
