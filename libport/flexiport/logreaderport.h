#ifndef FLEXIPORT_LOGREADERPORT_H_
#define FLEXIPORT_LOGREADERPORT_H_

#include <flexiport/backedport.h>

namespace flexiport {

// A tape in place of a device. Options: file (port.log), ignoretimes (off), strictness 0|1|2 (0), jitter in
// ms (100), and the replay options of porttape (timing, rate, at-end, …).
class FLEXIPORT_EXPORT LogReaderPort : public BackedPort {
 public:
  explicit LogReaderPort(std::map<std::string, std::string> options);
  virtual ~LogReaderPort();
};

}  // namespace flexiport

#endif
