#pragma once

#include "libport/port/port_type.hpp"

namespace porttape {

// `serial` makes SerialPort, `pty` PtyPort.
PortType serial_type();
PortType pty_type();

}  // namespace porttape
