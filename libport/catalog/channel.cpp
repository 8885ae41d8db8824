#include "libport/catalog/channel.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fmt/format.h>
#include <iterator>
#include <span>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/catalog/device_group.hpp"
#include "libport/catalog/port_guess.hpp"
#include "libport/catalog/port_types.hpp"
#include "libport/faults/types.hpp"
#include "libport/port/spelling.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

const OptionSpec kDriver{
    .name = "driver", .help = "what the driver opens, e.g. pty:/tmp/laser", .value_name = "PORT"};
const OptionSpec kDevice{
    .name = "device", .help = "where the device is, e.g. /dev/ttyUSB0,baud=115200", .value_name = "PORT"};
const OptionSpec kTape{.name = "tape",
                       .help = "the tape, e.g. laser: files laser.logr, laser.logw, laser.loge",
                       .value_name = "NAME"};
const OptionSpec kWaitDevice{"wait-device", Kind::flag, "",
                             "waits for a device that is missing, else that is an error"};

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

// A logreader's options that are options of the verb `replay` or `drive` too.
std::vector<OptionSpec> replay_options(ReplayUse use) {
  const std::vector<OptionSpec> common = with_common({});
  std::vector<OptionSpec> options;
  for (OptionSpec option : port_types().find("logreader")->options) {
    const bool is_common = std::ranges::find(common, option.name, &OptionSpec::name) != common.end();
    if (is_common || option.name == "file" || option.name == "ignoretimes") continue;
    if (use == ReplayUse::drive) {
      if (is_of_device(option.name)) continue;
      std::erase_if(option.choices, [&](std::string_view each) { return is_of_device(option.name, each); });
    }
    option.default_value = replay_default(use, option.name, option.default_value);
    option.help = replay_help(use, option.name, option.help);
    options.push_back(std::move(option));
  }
  return options;
}

// Both sides of a `drive`: the tape is in the driver's place, and --device is live.
std::vector<OptionSpec> drive_options() {
  std::vector<OptionSpec> options = replay_options(ReplayUse::drive);
  options.insert(options.begin(), {kTape, kDevice});
  options.push_back(kWaitDevice);
  return options;
}

Error in_option(std::string_view option, const Error& error) {
  return usage_error(fmt::format("option '{}': {}", option, error.message));
}

bool is_each(const OptionValues& values) {
  const auto given = values.find("connections");
  return given != values.end() && given->second == "each";
}

constexpr std::array kModes = {ChannelMode::record, ChannelMode::replay, ChannelMode::bridge};

Error unknown(std::string_view option, ChannelMode mode, std::vector<OptionSpec> known) {
  if (const auto owner = owner_of_option(option, mode)) return usage_error(*owner);
  const std::string of = fmt::format(" of {}", to_string(mode));
  Error error = unknown_option(option, known, of);
  if (error.message.ends_with('?')) return error;
  // The word may have decided on the mode, had it been the right one.
  for (const ChannelMode other : kModes) std::ranges::copy(channel_options(other), std::back_inserter(known));
  Error wider = unknown_option(option, known, of);
  return wider.message.ends_with('?') ? wider : error;
}

// A device or a port where a tape's name is wanted.
bool is_port(const std::string& tape) {
  std::error_code error;
  if (std::filesystem::is_character_file(tape, error)) return true;
  return tape.find(':') != std::string::npos && names_type(port_types(), tape) && !find_tape(tape);
}

// The value in its canonical form.
Result<std::string> checked_value(const OptionSpec& option, const std::string& value) {
  if (option.kind == Kind::text && value.empty())
    return usage_error(fmt::format("option '{}' is empty; accepted: {}", option.name, accepted_by(option)));
  if (option.name == kTape.name && is_port(value))
    return usage_error(
        fmt::format("option 'tape': {} is a port; accepted: a NAME for files, e.g. laser", in_quotes(value)));
  return check_value(option, value);
}

// The good ones of the options.
OptionValues checked_values(const ChannelSpec& spec, std::vector<OptionProblem>& problems) {
  const std::vector<OptionSpec> known = channel_options(spec.mode);
  OptionValues checked;
  for (const auto& [name, value] : spec.values) {
    const auto option = std::ranges::find(known, name, &OptionSpec::name);
    if (option == known.end()) {
      problems.push_back({name, unknown(name, spec.mode, known)});
    } else if (Result<std::string> good = checked_value(*option, value); !good) {
      problems.push_back({name, good.error()});
    } else if (option->kind != Kind::flag || !good->empty()) {
      checked.emplace(name, std::move(*good));
    }
  }
  for (const OptionSpec& option : known) {
    const std::string name(option.name);
    const bool required = name == kDriver.name || name == kDevice.name || name == kTape.name;
    if (required && !spec.values.contains(name))
      problems.push_back({"", usage_error(fmt::format("option '{}' is missing: {}, {}", name,
                                                      value_name(option), option.help))});
  }
  return checked;
}

// Of `logreader`, as it is read after set_replay_defaults().
Result<PortSpec> replayed(ReplayUse use, OptionValues values) {
  auto tape = values.extract("tape");
  for (const OptionSpec& other : {kDriver, kDevice, kConnections, kWaitDevice})
    values.erase(std::string(other.name));
  set_replay_defaults(use, values);
  values["file"] = std::move(tape.mapped());
  Result<PortOptions> port = check_options(PortOptions{port_types().find("logreader"), std::move(values)});
  if (!port) return port.error();
  return PortSpec::read(std::move(*port));
}

Result<PortSpec> replay_device(OptionValues values, const PortSpec& driver) {
  // Datagrams have no close that could end the one run.
  if (driver.type().keeps_datagrams && values.contains("once")) values.try_emplace("at-end", "exit");
  return replayed(ReplayUse::verb, std::move(values));
}

Result<PortSpec> replay_driver(const OptionValues& values) {
  Result<PortSpec> driver = replayed(ReplayUse::drive, values);
  if (!driver) return driver;
  ReplayOptions options = *driver->get<ReplayOptions>();
  options.config.writer = Writer::device;
  options.waits_for_line = values.contains("wait-device");
  driver->set(std::move(options));
  return driver;
}

// Where a user has said how the device's line is to be, it is not as the recorded driver found it.
void keep_line(PortSpec& driver, const PortSpec& device) {
  const std::vector<OptionSpec> settings = line_setting_options();
  ReplayOptions options = *driver.get<ReplayOptions>();
  options.keeps_line = std::ranges::any_of(
      settings, [&](const OptionSpec& each) { return device.written().has(std::string(each.name)); });
  driver.set(std::move(options));
}

// The port with a tape of it.
Result<PortOptions> recorded(const OptionValues& values, PortOptions device) {
  const PortType& type = *device.type;
  if (type.recorded_as.empty()) {
    return usage_error(fmt::format("a port of type {} cannot be recorded{}", type.name,
                                   type.records.empty() ? "" : "; give it to bridge"));
  }
  device.type = port_types().find(type.recorded_as);
  const Result<TapePaths> tape = named_new_tape(values.at("tape"));
  if (!tape) return usage_error("option 'tape': " + tape.error().message);
  device.values["file"] = tape->name();
  for (const OptionSpec& option : record_options()) {
    const auto given = values.find(std::string(name_at_record(option.name)));
    if (given != values.end()) device.values[std::string(option.name)] = given->second;
  }
  return device;
}

Error not_a_port(std::string_view option, const std::string& text, LineEnd end, const Error& error) {
  const std::optional<std::string> guess = guess_port(text, end);
  return in_option(option, guess ? usage_error(fmt::format("{} {}", in_quotes(text), *guess)) : error);
}

Result<PortSpec> driver_port(const std::string& text) {
  Result<PortSpec> driver = parse_port(text);
  if (!driver) return not_a_port("driver", text, LineEnd::driver, driver.error());
  return driver;
}

// With the faults that the verb's options ask for.
Result<PortOptions> with_faults_of(const OptionValues& values, PortOptions device) {
  bool asked = false;
  for (const OptionSpec& option : fault_options()) {
    const std::string name(option.name);
    const auto given = values.find(name);
    if (given == values.end()) continue;
    if (device.has(name))
      return usage_error(fmt::format("it has '{0}', and so has the channel; accepted: {0} once", name));
    device.values.emplace(name, given->second);
    asked = true;
  }
  return asked ? check_options(std::move(device)) : Result<PortOptions>(std::move(device));
}

Result<PortSpec> live_device(const OptionValues& values, ChannelMode mode) {
  const std::string& text = values.at("device");
  if (const auto meant = with_speed(text))
    return in_option("device", usage_error(fmt::format("{} has a speed behind it; did you mean {}?",
                                                       in_quotes(text), in_quotes(*meant))));
  Result<PortOptions> device = parse_options(port_types(), text);
  if (!device) return not_a_port("device", text, LineEnd::device, device.error());
  if (values.contains("wait-device") && device->type->find("wait") != nullptr)
    device->values["wait"] = values.at("wait-device");
  device = with_faults_of(values, std::move(*device));
  if (device && mode == ChannelMode::record) device = recorded(values, std::move(*device));
  if (!device) return in_option("device", device.error());
  Result<PortSpec> read = PortSpec::read(std::move(*device));
  if (!read) return in_option("device", read.error());
  return read;
}

// What a result has, or its error as the option's problem.
std::optional<PortSpec> take(Result<PortSpec> port, std::string option,
                             std::vector<OptionProblem>& problems) {
  if (port) return std::move(*port);
  problems.push_back({std::move(option), port.error()});
  return std::nullopt;
}

}  // namespace

std::string_view to_string(ChannelMode mode) {
  switch (mode) {
    case ChannelMode::record:
      return "record";
    case ChannelMode::replay:
      return "replay";
    case ChannelMode::drive:
      return "drive";
    case ChannelMode::bridge:
      break;
  }
  return "bridge";
}

std::optional<std::string> owner_of_option(std::string_view option, ChannelMode mode) {
  const auto has = [option](ChannelMode each) {
    const std::vector<OptionSpec> options = channel_options(each);
    return std::ranges::find(options, option, &OptionSpec::name) != options.end();
  };
  if (has(mode)) return std::nullopt;
  for (const ChannelMode other : kModes) {
    if (has(other))
      return fmt::format("option '{}' is one of {}, not of {}", option, to_string(other), to_string(mode));
  }
  for (const PortType& type : port_types().all()) {
    if (const OptionSpec* const spec = type.find(option)) {
      const std::string value = value_name(*spec);
      return fmt::format("option '{}' is one of a port; write it behind the port: PORT,{}{}{}", option,
                         option, value.empty() ? "" : "=", value);
    }
  }
  return std::nullopt;
}

std::vector<OptionSpec> channel_options(ChannelMode mode) {
  std::vector<OptionSpec> options;
  switch (mode) {
    case ChannelMode::record:
      options = record_options();
      for (OptionSpec& option : options) option.name = name_at_record(option.name);
      options.insert(options.begin(), {kDevice, kDriver, kTape});
      options.push_back(kConnections);
      options.push_back(kWaitDevice);
      std::ranges::copy(fault_options(), std::back_inserter(options));
      return options;
    case ChannelMode::replay:
      options = replay_options(ReplayUse::verb);
      options.insert(options.begin(), {kTape, kDriver, kConnections});
      return options;
    case ChannelMode::drive:
      return drive_options();
    case ChannelMode::bridge:
      break;
  }
  options = {kDevice, kDriver, kConnections, kWaitDevice};
  std::ranges::copy(fault_options(), std::back_inserter(options));
  return options;
}

ReadChannel read_channel(const ChannelSpec& spec) {
  ReadChannel read;
  const OptionValues values = checked_values(spec, read.problems);
  if (const auto driver = values.find("driver"); driver != values.end())
    read.driver = take(driver_port(driver->second), "driver", read.problems);
  // The one is made of both.
  const bool replays = spec.mode == ChannelMode::replay;
  if (replays && read.driver && values.contains("tape"))
    read.device = take(replay_device(values, *read.driver), "", read.problems);
  if (!replays && values.contains("device") && (values.contains("tape") || spec.mode == ChannelMode::bridge))
    read.device = take(live_device(values, spec.mode), "device", read.problems);
  if (spec.mode == ChannelMode::drive && values.contains("tape")) {
    read.driver = take(replay_driver(values), "", read.problems);
    if (read.driver && read.device) keep_line(*read.driver, *read.device);
  }
  read.each_connection = is_each(values);
  if (read.driver && read.device && values.contains("connections")) {
    Result<void> good = check_connections(*read.driver, *read.device, read.each_connection);
    if (!good) read.problems.push_back({"connections", good.error()});
  }
  return read;
}

Result<ChannelPorts> channel_ports(const ChannelSpec& spec) {
  ChannelSpec named = spec;
  const auto tape = named.values.find("tape");
  const bool plays = spec.mode == ChannelMode::replay || spec.mode == ChannelMode::drive;
  const bool replays = plays && tape != named.values.end();
  const Result<TapePaths> found = replays ? find_tape(tape->second) : Result<TapePaths>(TapePaths());
  // Of a group the first tape may be missing.
  const bool group =
      replays && !found && is_each(spec.values) && !tapes_of_group(new_tape(tape->second)).empty();
  if (replays && found) tape->second = found->name();
  if (group) tape->second = new_tape(tape->second).name();
  ReadChannel read = read_channel(named);
  if (!read.problems.empty()) return read.problems.front().error;
  if (!found && !group) return found.error();
  return ChannelPorts{std::move(*read.driver), std::move(*read.device), read.each_connection};
}

}  // namespace porttape
