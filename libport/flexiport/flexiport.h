#ifndef FLEXIPORT_FLEXIPORT_H_
#define FLEXIPORT_FLEXIPORT_H_

#include <exception>
#include <flexiport/config.h>
#include <flexiport/flexiport_types.h>
#include <map>
#include <string>

namespace flexiport {

class Port;

// What every function of this library throws.
class FLEXIPORT_EXPORT PortException : public std::exception {
 public:
  PortException(const char* errorDesc) throw() : _errorDesc(errorDesc) {}
  PortException(const std::string& errorDesc) throw() : _errorDesc(errorDesc) {}
  virtual ~PortException() throw() {}

  virtual const char* what() const throw() { return _errorDesc.c_str(); }

 protected:
  std::string _errorDesc;
};

// The port that the options name; the caller deletes it. Tokens are separated by ", \t\n"; each is key=value,
// or a bare key with the value "1". Throws PortException: no options, no type or an unknown one, an unknown
// option, a bad value.
FLEXIPORT_EXPORT Port* CreatePort(std::map<std::string, std::string> options);
FLEXIPORT_EXPORT Port* CreatePort(std::string options);

}  // namespace flexiport

#endif
