#ifndef FLEXIPORT_TIMEOUT_H_
#define FLEXIPORT_TIMEOUT_H_

#include <flexiport/flexiport_types.h>
#include <sys/time.h>
#include <time.h>

namespace flexiport {

// How long a call may take: seconds and microseconds. Seconds of -1: for ever; 0 and 0: it does not wait.
class FLEXIPORT_EXPORT Timeout {
 public:
  Timeout(int sec, int usec) : _sec(sec), _usec(usec) {}
  Timeout(const Timeout& rhs) : _sec(rhs._sec), _usec(rhs._usec) {}

  void AsTimeval(timeval& dest) const;
  void FromTimeval(const timeval& src);
  void AsTimespec(timespec& dest) const;
  void FromTimespec(const timespec& src);

  Timeout& operator=(const Timeout& rhs);
  Timeout& operator=(const timeval& rhs);
  Timeout& operator=(const timespec& rhs);

  int _sec;
  int _usec;
};

}  // namespace flexiport

#endif
