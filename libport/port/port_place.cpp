#include "libport/port/port_place.hpp"

#include "libport/port/spelling.hpp"

namespace porttape {

std::string PortPlace::text() const { return host.empty() ? path : host_and_port(host, port); }

}  // namespace porttape
