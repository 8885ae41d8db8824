#include "libport/port/port_factory.hpp"

#include <utility>

#include "libport/port/pty_port.hpp"
#include "libport/port/recording_port.hpp"
#include "libport/port/replay_port.hpp"
#include "libport/port/serial_port.hpp"
#include "libport/port/tcp_port.hpp"
#include "libport/port/udp_port.hpp"
#include "libport/port/unix_port.hpp"

namespace porttape {
namespace {

constexpr std::string_view kLogSuffix = "log";

template <class T>
std::unique_ptr<Port> made(const PortContext& context, const PortOptions& options) {
  return std::make_unique<T>(context, options);
}

Result<std::unique_ptr<Port>> make_replay_port(const PortContext& context, const PortOptions& options) {
  const Result<ReplayConfig> config = replay_config(options);
  if (!config) return config.error();
  ReplayPort::Options replay{
      literal_tape(options.text("file")), *config, options.flag("once"), options.text("report"), {}};
  return std::unique_ptr<Port>(std::make_unique<ReplayPort>(context, std::move(replay)));
}

OnExisting on_existing(const PortOptions& options) {
  const std::string chosen = options.text("on-existing");
  if (options.flag("overwrite") || chosen == "overwrite") return OnExisting::overwrite;
  return chosen == "next" ? OnExisting::next : OnExisting::refuse;
}

Result<std::unique_ptr<Port>> make_recording_port(const PortContext& context, const PortOptions& options,
                                                  const std::string& peer) {
  PortOptions inner = options;
  inner.type.resize(inner.type.size() - kLogSuffix.size());
  for (const char* own : {"file", "overwrite", "on-existing", "failclosed"}) inner.values.erase(own);
  Result<std::unique_ptr<Port>> port = make_port(context, inner, peer);
  if (!port) return port;
  TapeKeeper::Options tape{
      .tape = literal_tape(options.text("file")),
      .header = {.device = inner.spelled(),
                 .driver = peer,
                 .transport = (*port)->keeps_datagrams() ? Transport::datagram : Transport::stream,
                 .stamped = context.pulled ? Stamped::read : Stamped::arrival},
      .on_existing = on_existing(options),
      .fail_closed = options.flag("failclosed")};
  return std::unique_ptr<Port>(std::make_unique<RecordingPort>(
      context, std::move(*port), RecordingPort::Options{.tape = std::move(tape)}));
}

}  // namespace

Result<std::unique_ptr<Port>> make_port(const PortContext& context, const PortOptions& options,
                                        const std::string& peer) {
  if (options.type == "serial") return made<SerialPort>(context, options);
  if (options.type == "pty") return made<PtyPort>(context, options);
  if (options.type == "tcp") return made<TcpPort>(context, options);
  if (options.type == "udp") return made<UdpPort>(context, options);
  if (options.type == "unix") return made<UnixPort>(context, options);
  if (options.type == "logreader") return make_replay_port(context, options);
  if (options.type.ends_with(kLogSuffix)) return make_recording_port(context, options, peer);
  return make_error(Errc::usage, "unknown port type '" + options.type + "'");
}

}  // namespace porttape
