#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/base/tty_device.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/catalog/port_types.hpp"
#include "libport/supervise/tapped_line.hpp"
#include "tools/cassette_verbs.hpp"
#include "tools/command_run.hpp"
#include "tools/command_verb.hpp"
#include "tools/supervision.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr std::string_view kExecAbout =
    "Runs COMMAND under a supervisor that gives it what a pty lacks: modem lines and\n"
    "their counters, breaks, parity and data bits, drains that last as long as the\n"
    "device needs, an exact place for each setting and flush. COMMAND is not changed,\n"
    "and may be static, have threads, fork, or be debugged. It finds its port in\n"
    "lists of ports, as the device or as --as has it. A setuid program runs without\n"
    "its rights, which is told. Before Linux 6.6 each of these calls takes some 10 us\n"
    "more.\n\n"
    "  --device PORT              a line to this device\n"
    "  --device PORT --tape NAME  and a tape of it, as `porttape record --exec`\n"
    "  --tap --tape NAME          no port: a tape of what COMMAND and its own device\n"
    "                             say, at their own line\n"
    "  --tape NAME                the tape in the device's place; what COMMAND does\n"
    "                             otherwise is told (`porttape test --exec` judges)\n\n"
    "Exit status: COMMAND's own, 128 + N after signal N. Without COMMAND having run:\n"
    "2 wrong use, 6 no such device. Where COMMAND gave 0: 1 or 6 for our own trouble.\n\n";

void tell_exec(std::ostream& err, std::string_view text) {
  fmt::print(err, "porttape exec: {}\n", printable_line(text));
}

std::vector<OptionSpec> exec_options() {
  std::vector<OptionSpec> specs = supervision_options(false);
  specs.push_back({.name = "tap",
                   .kind = OptionSpec::Kind::flag,
                   .help = "no port: what the command says to its own device is recorded; --device PATH "
                           "says which, else the first tty that it opens"});
  for (const ChannelMode mode : {ChannelMode::record, ChannelMode::bridge, ChannelMode::replay}) {
    for (OptionSpec& spec : options_of_one_run(mode)) {
      const bool known = std::ranges::find(specs, spec.name, &OptionSpec::name) != specs.end();
      if (!known) specs.push_back(std::move(spec));
    }
  }
  return specs;
}

// Without a tape that is made: a line to a device, or a tape in its place.
Result<int> run_on_line(const CommandVerbLine& line, ChannelMode mode, const Supervision& supervision,
                        std::ostream& err) {
  const Result<ChannelPorts> ports = channel_ports({mode, line.values});
  if (!ports) return ports.error();
  CommandRun run({.name = "porttape exec",
                  .log_level = spdlog::level::warn,
                  .waits_after_signal = true,
                  .supervision = supervision});
  if (Result<void> started = run.start_session(*ports); !started) return started.error();
  if (Result<void> ran = run.run_command(line.command); !ran) return ran.error();
  run.finish();
  for (const std::string& note : run.notes()) tell_exec(err, note);
  if (run.counters().opens == 0)
    tell_exec(err,
              "the command never opened its port: write {port} in COMMAND for what it is to open, or let "
              "it open $PORTTAPE_PORT");
  const int status = run.command_end().exit_code();
  if (status != exit_status::kPass) return status;
  return mode == ChannelMode::bridge && run.counters().device_losses > 0 ? exit_status::kDevice : status;
}

struct TappedDevice {
  std::string path;
  std::optional<TtyDevice> device = {};
};

// The serial device of this name, a path or a port.
Result<TappedDevice> tapped_device(const std::string& named) {
  std::string path = named;
  if (::access(named.c_str(), F_OK) != 0) {
    const Result<PortSpec> port = parse_port(named);
    if (!port) return port.error();
    if (port->type().name != "serial")
      return make_error(Errc::usage,
                        fmt::format("--device {}: with --tap it is the path of the serial device "
                                    "that COMMAND opens",
                                    in_quotes(named)));
    path = port->written().text("device");
  }
  if (const std::optional<TtyDevice> device = tty_device_at(path)) return TappedDevice{path, device};
  if (::access(path.c_str(), F_OK) != 0)
    return make_error(Errc::device_missing,
                      fmt::format("--device {}: {}", in_quotes(path), errno_text(errno)));
  return make_error(Errc::usage, fmt::format("--device {} is no tty", in_quotes(path)));
}

// The command on its own device, of which a tape is made.
Result<int> run_tapped(CommandVerbLine line, Supervision supervision, std::ostream& err) {
  if (!line.values.contains("tape"))
    return make_error(Errc::usage,
                      "--tape NAME is missing; type porttape exec --tap --tape NAME -- COMMAND…");
  if (!line.own_driver)
    return make_error(Errc::usage, "--driver does not go with --tap: the command has its own device");
  const auto named = line.values.find("device");
  const Result<TappedDevice> device =
      named != line.values.end() ? tapped_device(named->second) : TappedDevice();
  if (!device) return device.error();
  const auto wants_port = [](const auto& word) { return word.find("{port}") != std::string::npos; };
  if (device->path.empty() && std::ranges::any_of(line.command, wants_port))
    return make_error(Errc::usage, "with --tap {port} is the path of --device, which is missing");
  line.values["device"] = "serial:" + (device->path.empty() ? "its-own" : device->path);
  supervision.tapped_device = device->device;
  supervision.tapped = std::make_shared<TappedLine>(device->path);
  return record_supervised(std::move(line), supervision, err);
}

Result<int> exec_on(CommandVerbLine line, std::ostream& err) {
  const Result<std::optional<Supervision>> supervision = take_supervision(line.values, false);
  if (!supervision) return supervision.error();
  if (line.values.erase("tap") > 0) return run_tapped(std::move(line), **supervision, err);
  const bool device = line.values.contains("device");
  const bool tape = line.values.contains("tape");
  if (!device && !tape) {
    return make_error(Errc::usage,
                      "--device PORT is missing, or --tape NAME of a tape in its place; type porttape exec "
                      "--device PORT -- COMMAND…");
  }
  if (device && tape) return record_supervised(std::move(line), **supervision, err);
  return run_on_line(line, device ? ChannelMode::bridge : ChannelMode::replay, **supervision, err);
}

}  // namespace

int run_exec(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "exec",
                         .usage = "[--device PORT] [--tape NAME] [options] -- COMMAND…",
                         .about = kExecAbout,
                         .options = exec_options(),
                         .example = "--device /dev/ttyUSB0 --tape ups -- ./ups_driver {port}"};
  return run_command_verb(verb, args, out, err,
                          [&](CommandVerbLine line) { return exec_on(std::move(line), err); });
}

}  // namespace porttape
