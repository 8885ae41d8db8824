#include "libport/session/channel.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <utility>

#include "libport/port/port_factory.hpp"
#include "libport/port/replay_port.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

// A logreader's options that are options of the verb `replay` too, where the verb's default differs.
constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kReplayDefaults = {
    {{"strictness", "1"}, {"timing", "reactive"}}};

const OptionSpec kDriver{"driver", Kind::text, "", "PORT that the driver opens, e.g. pty:/tmp/laser"};
const OptionSpec kDevice{"device", Kind::text, "",
                         "PORT of the device, e.g. serial:/dev/ttyUSB0,baud=115200"};
const OptionSpec kTape{"tape", Kind::text, "", "NAME of the tape: NAMEr, NAMEw, NAMEe"};
const OptionSpec kWaitDevice{"wait-device", Kind::flag, "", "a device that is missing is waited for"};

const OptionSpec kOnExisting{
    "on-existing",
    Kind::choice,
    "refuse",
    "a tape of that name is there: an error, the next free name (laser.2.log), or it is replaced",
    0,
    0,
    {"refuse", "next", "overwrite"}};

bool is_replay_option(const OptionSpec& option) {
  const PortType* serial = find_port_type("serial");
  const bool common = serial->find(option.name) != nullptr;
  return !common && option.name != "file" && option.name != "ignoretimes";
}

std::vector<OptionSpec> replay_options() {
  std::vector<OptionSpec> options;
  for (OptionSpec option : find_port_type("logreader")->options) {
    if (!is_replay_option(option)) continue;
    for (const auto& [name, value] : kReplayDefaults) {
      if (option.name == name) option.default_value = value;
    }
    options.push_back(std::move(option));
  }
  return options;
}

Error usage(std::string message) { return make_error(Errc::usage, std::move(message)); }

// The options with checked values; flags that are off are absent.
Result<std::map<std::string, std::string>> check_values(const ChannelSpec& spec) {
  const std::vector<OptionSpec> known = channel_options(spec.mode);
  std::map<std::string, std::string> checked;
  for (const auto& [name, value] : spec.values) {
    const auto option = std::ranges::find(known, name, &OptionSpec::name);
    if (option == known.end()) {
      std::vector<std::string_view> names;
      for (const OptionSpec& each : known) names.push_back(each.name);
      return usage(
          fmt::format("unknown option '{}' ('{}'); accepted: {}", name, value, fmt::join(names, ", ")));
    }
    Result<std::string> good = check_value(*option, value);
    if (!good) return good.error();
    if (option->kind != Kind::flag || !good->empty()) checked[name] = std::move(*good);
  }
  for (const std::string_view required : {"driver", "device", "tape"}) {
    const bool wanted = std::ranges::find(known, required, &OptionSpec::name) != known.end();
    if (wanted && checked[std::string(required)].empty()) {
      return usage(fmt::format("option '{}' is missing; see --help", required));
    }
  }
  return checked;
}

Result<PortOptions> named_port(std::string_view option, const std::string& spec) {
  Result<PortOptions> port = parse_port(spec);
  if (!port) return usage(fmt::format("option '{}': {}", option, port.error().message));
  return port;
}

Result<PortOptions> replay_device(std::map<std::string, std::string> values) {
  const std::string tape = std::exchange(values["tape"], {});
  values.erase("tape");
  values.erase("driver");
  for (const auto& [name, value] : kReplayDefaults) values.try_emplace(std::string(name), value);
  PortOptions device{"logreader", std::move(values)};
  device.values["file"] = tape;
  Result<PortOptions> checked = check_port(std::move(device));
  if (!checked) return checked;
  if (const Result<ReplayConfig> config = replay_config(*checked); !config) return config.error();
  return checked;
}

Result<PortOptions> recording_device(const std::map<std::string, std::string>& values, PortOptions device) {
  const std::string recorded = device.type + "log";
  if (find_port_type(recorded) == nullptr) {
    return usage(fmt::format("option 'device': a port of type {} cannot be recorded{}", device.type,
                             device.type.ends_with("log") ? "; give it to bridge" : ""));
  }
  device.type = recorded;
  device.values["file"] = new_tape(values.at("tape")).name();
  const auto existing = values.find("on-existing");
  if (existing != values.end()) device.values["on-existing"] = existing->second;
  if (values.contains("overwrite")) device.values["on-existing"] = "overwrite";
  if (values.contains("fail-closed")) device.values["failclosed"] = "1";
  return device;
}

}  // namespace

std::vector<OptionSpec> channel_options(ChannelMode mode) {
  std::vector<OptionSpec> options;
  switch (mode) {
    case ChannelMode::record:
      return {kDevice,
              kDriver,
              kTape,
              kOnExisting,
              {"overwrite", Kind::flag, "", "short for --on-existing overwrite"},
              {"fail-closed", Kind::flag, "", "ends when the tape cannot be written; else the line stays up"},
              kWaitDevice};
    case ChannelMode::replay:
      options = replay_options();
      options.insert(options.begin(), {kTape, kDriver});
      return options;
    case ChannelMode::bridge:
      break;
  }
  return {kDevice, kDriver, kWaitDevice};
}

Result<ChannelPorts> channel_ports(const ChannelSpec& spec) {
  Result<ChannelPorts> ports = named_ports(spec);
  if (!ports || spec.mode != ChannelMode::replay) return ports;
  const Result<TapePaths> tape = find_tape(ports->device.text("file"));
  if (!tape) return tape.error();
  ports->device.values["file"] = tape->name();
  return ports;
}

Result<ChannelPorts> named_ports(const ChannelSpec& spec) {
  const Result<std::map<std::string, std::string>> values = check_values(spec);
  if (!values) return values.error();
  Result<PortOptions> driver = named_port("driver", values->at("driver"));
  if (!driver) return driver.error();
  Result<PortOptions> device =
      spec.mode == ChannelMode::replay ? replay_device(*values) : named_port("device", values->at("device"));
  if (!device) return device.error();
  // Datagrams have no close that could end the one run.
  if (spec.mode == ChannelMode::replay && driver->type == "udp" && device->flag("once") &&
      !values->contains("at-end"))
    device->values["at-end"] = "exit";
  if (values->contains("wait-device") && find_port_type(device->type)->find("wait") != nullptr)
    device->values["wait"] = "1";
  if (spec.mode == ChannelMode::record) device = recording_device(*values, std::move(*device));
  if (!device) return device.error();
  return ChannelPorts{std::move(*driver), std::move(*device)};
}

Result<std::unique_ptr<Session>> make_session(const PortContext& context, const ChannelPorts& ports,
                                              std::function<void(int)> on_end) {
  Result<std::unique_ptr<Port>> driver = make_port(context, ports.driver, ports.device.spelled());
  if (!driver) return driver.error();
  Result<std::unique_ptr<Port>> device = make_port(context, ports.device, ports.driver.spelled());
  if (!device) return device.error();
  return std::make_unique<Session>(context, std::move(*driver), std::move(*device), std::move(on_end));
}

}  // namespace porttape
