#include "libport/catalog/port_types.hpp"

#include <utility>
#include <vector>

#include "libport/faults/types.hpp"
#include "libport/net/types.hpp"
#include "libport/taped/types.hpp"
#include "libport/tty/types.hpp"

namespace porttape {
namespace {

// A wrapper for all ports goes around each before those that record are made, so that it stands between the
// tape and the device. What a driver writes to a tape is to be what it wrote, where nothing else is said.
std::vector<PortType> all_types() {
  std::vector<PortType> types = {
      with_faults(serial_type()), with_faults(pty_type()), with_faults(logreader_type(), LineDir::r),
      with_faults(tcp_type()),    with_faults(udp_type()), with_faults(unix_type())};
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
