#ifndef FLEXIPORT_TCPPORT_H_
#define FLEXIPORT_TCPPORT_H_

#include <flexiport/backedport.h>

namespace flexiport {

// A TCP connection. Options: ip (127.0.0.1; * with listen: any address), port (20000), listen (off): Open()
// waits for a connection.
class FLEXIPORT_EXPORT TCPPort : public BackedPort {
 public:
  explicit TCPPort(std::map<std::string, std::string> options);
  virtual ~TCPPort();
};

}  // namespace flexiport

#endif
