#pragma once

#include "libport/port/port_type.hpp"

namespace porttape {

// `tcp` makes TcpPort, `udp` UdpPort, `unix` UnixPort.
PortType tcp_type();
PortType udp_type();
PortType unix_type();

}  // namespace porttape
