#include "tools/tap.hpp"

#include <utility>

#include "libport/port/port_options.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

// Which end of which line a port of these types is.
struct TappedEnd {
  std::shared_ptr<TappedLine> line;
};

PortType tapped_type(std::string_view name, std::string_view main,
                     std::unique_ptr<Port> (TappedLine::*port)()) {
  PortType type{name, {main}, "an end of a line that a command has by itself"};
  type.options = {{.name = main, .help = "its name"}};
  type.read = reads([](const PortOptions&) -> Result<TappedEnd> { return TappedEnd(); });
  type.make = makes<TappedEnd>(
      [port](const auto&, const auto&, const TappedEnd& end) { return ((*end.line).*port)(); });
  return type;
}

Result<PortSpec> tapped_port(const PortType& type, const std::string& name,
                             const std::shared_ptr<TappedLine>& line) {
  Result<PortSpec> port = PortSpec::read(PortOptions{&type, {{std::string(type.form.main), name}}});
  if (port) port->set(TappedEnd{line});
  return port;
}

}  // namespace

Result<ChannelPorts> tapped_ports(ChannelPorts ports, const std::shared_ptr<TappedLine>& line,
                                  const std::string& command) {
  static const PortType of_driver = tapped_type("tap", "command", &TappedLine::driver_port);
  static const PortType of_device = tapped_type("serial", "device", &TappedLine::device_port);
  Result<PortSpec> driver = tapped_port(of_driver, command, line);
  if (!driver) return driver.error();
  RecordingOptions recording = *ports.device.get<RecordingOptions>();
  Result<PortSpec> inner = tapped_port(of_device, recording.inner.written().text("device"), line);
  if (!inner) return inner.error();
  recording.inner = std::move(*inner);
  recording.device_name = [line] { return line->device_name(); };
  ports.device.set(std::move(recording));
  ports.driver = std::move(*driver);
  return ports;
}

}  // namespace porttape
