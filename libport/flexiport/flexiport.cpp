#include <flexiport/backedport.h>
#include <flexiport/flexiport.h>
#include <flexiport/logreaderport.h>
#include <flexiport/logwriterport.h>
#include <flexiport/serialport.h>
#include <flexiport/tcpport.h>
#include <flexiport/udpport.h>

#include "libport/catalog/port_types.hpp"
#include "libport/flexiport/backing.hpp"
#include "libport/port/spelling.hpp"

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
  const porttape::PortType* known = porttape::port_types().find(type);
  if (known != nullptr && !known->records.empty()) return new LogWriterPort(options);
  return new OtherPort(type, options);
}

Port* CreatePort(std::string options) {
  std::map<std::string, std::string> taken;
  for (const std::string_view token : porttape::split_tokens(options, kSeparators)) {
    auto [option, value] = porttape::split_option(token);
    taken[std::move(option)] = std::move(value);
  }
  return CreatePort(taken);
}

}  // namespace flexiport
