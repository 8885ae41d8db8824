#ifndef FLEXIPORT_UDPPORT_H_
#define FLEXIPORT_UDPPORT_H_

#include <flexiport/backedport.h>

namespace flexiport {

// UDP datagrams; a Read gives at most one. Options: dest_ip (127.0.0.1), dest_port (20000), recv_ip (*),
// recv_port (20000).
class FLEXIPORT_EXPORT UDPPort : public BackedPort {
 public:
  explicit UDPPort(std::map<std::string, std::string> options);
  virtual ~UDPPort();
};

}  // namespace flexiport

#endif
