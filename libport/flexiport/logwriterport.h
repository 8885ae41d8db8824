#ifndef FLEXIPORT_LOGWRITERPORT_H_
#define FLEXIPORT_LOGWRITERPORT_H_

#include <flexiport/backedport.h>

namespace flexiport {

// A port of another type with a tape of it. Options: type (seriallog, tcplog, udplog, …), file (port.log),
// those of the other type. An existing tape is replaced.
class FLEXIPORT_EXPORT LogWriterPort : public BackedPort {
 public:
  explicit LogWriterPort(std::map<std::string, std::string> options);
  virtual ~LogWriterPort();
};

}  // namespace flexiport

#endif
