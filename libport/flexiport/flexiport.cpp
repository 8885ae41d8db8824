#include <flexiport/backedport.h>
#include <flexiport/flexiport.h>
#include <flexiport/logreaderport.h>
#include <flexiport/logwriterport.h>
#include <flexiport/serialport.h>
#include <flexiport/tcpport.h>
#include <flexiport/udpport.h>

#include "libport/flexiport/backing.hpp"

namespace flexiport {
namespace {

constexpr const char* kSeparators = ", \t\n";

// The types that flexiport has no class for.
class OtherPort final : public BackedPort {
 public:
  OtherPort(const std::string& type, const std::map<std::string, std::string>& options)
      : BackedPort(type, type, options) {
    _backing->other = true;
  }
};

}  // namespace

Port* CreatePort(std::map<std::string, std::string> options) {
  if (options.empty()) throw PortException("No options specified. Must specify a port type.");
  const auto found = options.find("type");
  if (found == options.end()) throw PortException("No port type specified.");
  const std::string type = found->second;
  if (type == "serial") return new SerialPort(options);
  if (type == "tcp") return new TCPPort(options);
  if (type == "udp") return new UDPPort(options);
  if (type == "logreader") return new LogReaderPort(options);
  if (type.ends_with("log")) return new LogWriterPort(options);
  return new OtherPort(type, options);
}

Port* CreatePort(std::string options) {
  std::map<std::string, std::string> taken;
  std::size_t begin = options.find_first_not_of(kSeparators);
  while (begin != std::string::npos) {
    const std::size_t end = options.find_first_of(kSeparators, begin);
    const std::string token = options.substr(begin, end == std::string::npos ? end : end - begin);
    const std::size_t equals = token.find('=');
    taken[token.substr(0, equals)] = equals == std::string::npos ? "1" : token.substr(equals + 1);
    begin = options.find_first_not_of(kSeparators, end);
  }
  return CreatePort(taken);
}

}  // namespace flexiport
