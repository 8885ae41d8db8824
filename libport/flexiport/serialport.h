#ifndef FLEXIPORT_SERIALPORT_H_
#define FLEXIPORT_SERIALPORT_H_

#include <flexiport/backedport.h>

namespace flexiport {

// A serial device. Options: device (/dev/ttyS0), baud (9600), parity none|even|odd (none), databits (8),
// stopbits 1|2 (1), hwflowctrl (off).
class FLEXIPORT_EXPORT SerialPort : public BackedPort {
 public:
  explicit SerialPort(std::map<std::string, std::string> options);
  virtual ~SerialPort();

  // bit/s; at once when the port is open.
  void SetBaudRate(unsigned int baud);
  unsigned int GetBaudRate() const { return _baud; }

 private:
  unsigned int _baud;
};

}  // namespace flexiport

#endif
