// The ports by name: what sets each apart is its options.

#include <flexiport/logreaderport.h>
#include <flexiport/logwriterport.h>
#include <flexiport/serialport.h>
#include <flexiport/tcpport.h>
#include <flexiport/udpport.h>

#include "libport/catalog/port_types.hpp"
#include "libport/flexiport/backing.hpp"
#include "libport/taped/types.hpp"

namespace flexiport {
namespace {

using Options = std::map<std::string, std::string>;

std::string recorded_type(const Options& options) {
  const auto type = options.find("type");
  if (type == options.end()) throw PortException("No port type specified.");
  const porttape::PortType* known = porttape::port_types().find(type->second);
  if (known == nullptr || known->records.empty()) {
    throw PortException("Not a port with a log: " + type->second + " (seriallog, tcplog, udplog, …)");
  }
  return type->second;
}

Options replacing(Options options) {
  options.try_emplace("overwrite", "1");
  return options;
}

// flexiport's rules where they differ from porttape's: times that are ignored make everything readable
// whatever is written, and a late write is never wrong.
Options documented(Options options) {
  porttape::set_replay_defaults(porttape::ReplayUse::drop_in, options);
  const auto ignored = options.find("ignoretimes");
  if (ignored == options.end() || options.contains("timing")) return options;
  const auto value = ignored->second;
  if (value == "0" || value == "off" || value == "no" || value == "false") return options;
  options.erase(ignored);
  options["timing"] = "recorded";
  options["rate"] = "1000000";
  if (const auto strictness = options.find("strictness");
      strictness != options.end() && strictness->second == "2") {
    strictness->second = "1";
  }
  return options;
}

// A serial port is one with a tape of it, or a tape in its place, where its options say so.
std::string serial_type(const Options& options) {
  const auto type = options.find("type");
  const bool with_tape =
      type != options.end() && (type->second == "seriallog" || type->second == "logreader");
  return with_tape ? type->second : "serial";
}

Options serial_options(Options options) {
  const std::string type = serial_type(options);
  return type == "seriallog"   ? replacing(std::move(options))
         : type == "logreader" ? documented(std::move(options))
                               : options;
}

constexpr unsigned kDefaultBaud = 9600;

}  // namespace

SerialPort::SerialPort(std::map<std::string, std::string> options)
    : BackedPort("serial", serial_type(options), serial_options(options)), _baud(kDefaultBaud) {
  const std::string type = serial_type(options);
  if (type == "logreader") return;  // whose tape is read when it is opened
  options["type"] = type;
  const porttape::Result<porttape::PortOptions> known = porttape::check_options(std::move(options));
  if (!known) raise(known.error());
  _baud = static_cast<unsigned>(known->integer("baud"));
}

SerialPort::~SerialPort() = default;

void SerialPort::SetBaudRate(unsigned int baud) {
  if (baud == 0) throw PortException("Bad baud rate: 0");
  if (const porttape::Result<void> set = _backing->port->set_baud(baud); !set) raise(set.error());
  _baud = baud;
}

TCPPort::TCPPort(std::map<std::string, std::string> options) : BackedPort("tcp", "tcp", options) {}
TCPPort::~TCPPort() = default;

UDPPort::UDPPort(std::map<std::string, std::string> options) : BackedPort("udp", "udp", options) {}
UDPPort::~UDPPort() = default;

LogReaderPort::LogReaderPort(std::map<std::string, std::string> options)
    : BackedPort("logreader", "logreader", documented(options)) {}
LogReaderPort::~LogReaderPort() = default;

LogWriterPort::LogWriterPort(std::map<std::string, std::string> options)
    : BackedPort("logwriter", recorded_type(options), replacing(options)) {}
LogWriterPort::~LogWriterPort() = default;

}  // namespace flexiport
