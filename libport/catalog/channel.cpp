#include "libport/catalog/channel.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

#include "libport/catalog/device_group.hpp"
#include "libport/catalog/port_types.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

const OptionSpec kDriver{"driver", Kind::text, "", "PORT that the driver opens, e.g. pty:/tmp/laser"};
const OptionSpec kDevice{"device", Kind::text, "",
                         "PORT of the device, e.g. serial:/dev/ttyUSB0,baud=115200"};
const OptionSpec kTape{"tape", Kind::text, "", "NAME of the tape: NAMEr, NAMEw, NAMEe"};
const OptionSpec kWaitDevice{"wait-device", Kind::flag, "", "a device that is missing is waited for"};

const OptionSpec kConnections{
    "connections",
    Kind::choice,
    "one",
    "drivers at once on a port that listens: one (others are refused), or each with a device's port and a "
    "tape of its own (laser.log, laser.c2.log, …)",
    0,
    0,
    {"one", "each"}};

// flexiport's name for it is another one than the verb's.
constexpr std::string_view kFailClosed = "fail-closed";

std::string_view name_at_record(std::string_view option) {
  return option == "failclosed" ? kFailClosed : option;
}

// A recording port's options that are options of the verb `record` too.
std::vector<OptionSpec> record_options() {
  std::vector<OptionSpec> options = tape_options();
  std::erase_if(options, [](const OptionSpec& option) { return option.name == "file"; });
  return options;
}

// A logreader's options that are options of the verb `replay` too.
std::vector<OptionSpec> replay_options() {
  const std::vector<OptionSpec> common = with_common({});
  std::vector<OptionSpec> options;
  for (OptionSpec option : port_types().find("logreader")->options) {
    const bool is_common = std::ranges::find(common, option.name, &OptionSpec::name) != common.end();
    if (is_common || option.name == "file" || option.name == "ignoretimes") continue;
    option.default_value = replay_default(ReplayUse::verb, option.name, option.default_value);
    options.push_back(std::move(option));
  }
  return options;
}

Error usage(std::string message) { return make_error(Errc::usage, std::move(message)); }

// The options with checked values.
Result<OptionValues> checked_values(const ChannelSpec& spec) {
  const std::vector<OptionSpec> known = channel_options(spec.mode);
  Result<OptionValues> checked = check_values(known, spec.values);
  if (!checked) return checked;
  for (const std::string_view required : {"driver", "device", "tape"}) {
    const bool wanted = std::ranges::find(known, required, &OptionSpec::name) != known.end();
    const auto given = checked->find(std::string(required));
    if (wanted && (given == checked->end() || given->second.empty()))
      return usage(fmt::format("option '{}' is missing; see --help", required));
  }
  return checked;
}

Error in_option(std::string_view option, const Error& error) {
  return usage(fmt::format("option '{}': {}", option, error.message));
}

bool is_each(const OptionValues& values) {
  const auto given = values.find("connections");
  return given != values.end() && given->second == "each";
}

Result<PortSpec> replay_device(OptionValues values, const PortSpec& driver, bool find) {
  const bool each = is_each(values);
  auto tape = values.extract("tape");
  values.erase("driver");
  values.erase("connections");
  // Datagrams have no close that could end the one run.
  if (driver.type().keeps_datagrams && values.contains("once")) values.try_emplace("at-end", "exit");
  set_replay_defaults(ReplayUse::verb, values);
  if (find) {
    const Result<TapePaths> found = find_tape(tape.mapped());
    if (!found && (!each || tapes_of_group(new_tape(tape.mapped())).empty())) return found.error();
    tape.mapped() = found ? found->name() : new_tape(tape.mapped()).name();
  }
  values["file"] = std::move(tape.mapped());
  Result<PortOptions> device = check_options(PortOptions{port_types().find("logreader"), std::move(values)});
  if (!device) return device.error();
  return PortSpec::read(std::move(*device));
}

// The port with a tape of it.
Result<PortOptions> recorded(const OptionValues& values, PortOptions device) {
  const PortType& type = *device.type;
  if (type.recorded_as.empty()) {
    return usage(fmt::format("a port of type {} cannot be recorded{}", type.name,
                             type.records.empty() ? "" : "; give it to bridge"));
  }
  device.type = port_types().find(type.recorded_as);
  device.values["file"] = new_tape(values.at("tape")).name();
  for (const OptionSpec& option : record_options()) {
    const auto given = values.find(std::string(name_at_record(option.name)));
    if (given != values.end()) device.values[std::string(option.name)] = given->second;
  }
  return device;
}

Result<PortSpec> live_device(const OptionValues& values, ChannelMode mode) {
  Result<PortOptions> device = parse_options(port_types(), values.at("device"));
  if (device && values.contains("wait-device") && device->type->find("wait") != nullptr)
    device->values["wait"] = values.at("wait-device");
  if (device && mode == ChannelMode::record) device = recorded(values, std::move(*device));
  if (!device) return in_option("device", device.error());
  Result<PortSpec> read = PortSpec::read(std::move(*device));
  if (!read) return in_option("device", read.error());
  return read;
}

Result<ChannelPorts> ports_of(const ChannelSpec& spec, bool find) {
  const Result<OptionValues> values = checked_values(spec);
  if (!values) return values.error();
  Result<PortSpec> driver = parse_port(values->at("driver"));
  if (!driver) return in_option("driver", driver.error());
  Result<PortSpec> device = spec.mode == ChannelMode::replay ? replay_device(*values, *driver, find)
                                                             : live_device(*values, spec.mode);
  if (!device) return device.error();
  if (values->contains("connections")) {
    if (Result<void> good = check_connections(*driver, *device, is_each(*values)); !good) return good.error();
  }
  return ChannelPorts{std::move(*driver), std::move(*device), is_each(*values)};
}

}  // namespace

std::vector<OptionSpec> channel_options(ChannelMode mode) {
  std::vector<OptionSpec> options;
  switch (mode) {
    case ChannelMode::record:
      options = record_options();
      for (OptionSpec& option : options) option.name = name_at_record(option.name);
      options.insert(options.begin(), {kDevice, kDriver, kTape});
      options.push_back(kConnections);
      options.push_back(kWaitDevice);
      return options;
    case ChannelMode::replay:
      options = replay_options();
      options.insert(options.begin(), {kTape, kDriver, kConnections});
      return options;
    case ChannelMode::bridge:
      break;
  }
  return {kDevice, kDriver, kConnections, kWaitDevice};
}

Result<ChannelPorts> channel_ports(const ChannelSpec& spec) { return ports_of(spec, true); }
Result<ChannelPorts> named_ports(const ChannelSpec& spec) { return ports_of(spec, false); }

}  // namespace porttape
