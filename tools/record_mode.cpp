#include "tools/record_mode.hpp"

#include <algorithm>
#include <cstdlib>
#include <fmt/format.h>
#include <string_view>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {
namespace {

constexpr const char* kName = "record-mode";

bool under_ci() {
  const char* const value = std::getenv("CI");
  const std::string_view text = value == nullptr ? "" : value;
  return !text.empty() && text != "false" && text != "0";
}

Result<RecordMode> mode_of(const std::map<std::string, std::string>& values) {
  const auto given = values.find(kName);
  if (given == values.end()) return RecordMode::none;
  const Result<std::string> choice = check_value(record_mode_option(), given->second);
  if (!choice) return choice.error();
  return *choice == "once" ? RecordMode::once : RecordMode::none;
}

bool has(const std::vector<OptionSpec>& specs, const std::string& name) {
  return std::ranges::find(specs, name, &OptionSpec::name) != specs.end();
}

}  // namespace

OptionSpec record_mode_option() {
  return {.name = kName,
          .kind = OptionSpec::Kind::choice,
          .default_value = "none",
          .help =
              "with a tape that is not there: none: nothing is recorded, and --device is not opened; once: "
              "it is recorded from --device. Under CI (its environment variable) always none",
          .choices = {"none", "once"}};
}

Result<Cassette> choose_cassette(const std::map<std::string, std::string>& values) {
  const Result<RecordMode> mode = mode_of(values);
  if (!mode) return mode.error();
  Cassette cassette;
  const bool ci = *mode == RecordMode::once && under_ci();
  if (ci) cassette.note = "under CI nothing is recorded: --record-mode none instead of once";
  const auto tape = values.find("tape");
  if (tape == values.end()) return cassette;  // which is told by the verb
  const Result<TapePaths> found = find_tape(tape->second);
  if (found) return cassette;
  if (*mode == RecordMode::none || ci) {
    return make_error(found.error().code,
                      fmt::format("{}; {}", found.error().message,
                                  ci ? "under CI nothing is recorded: record it where the device is, with "
                                       "--record-mode once, and keep it beside the test"
                                     : "--record-mode once records it from --device"));
  }
  if (!values.contains("device")) {
    return make_error(Errc::usage,
                      fmt::format("{}, and there is no --device to record it from", found.error().message));
  }
  cassette.records = true;
  return cassette;
}

std::map<std::string, std::string> values_to_record(std::map<std::string, std::string> values) {
  const std::vector<OptionSpec> own = channel_options(ChannelMode::record);
  std::erase_if(values, [&](const auto& value) { return !has(own, value.first); });
  return values;
}

std::map<std::string, std::string> values_to_play(std::map<std::string, std::string> values) {
  const std::vector<OptionSpec> own = channel_options(ChannelMode::replay);
  const std::vector<OptionSpec> others = channel_options(ChannelMode::record);
  std::erase_if(values, [&](const auto& value) {
    return value.first == kName || (has(others, value.first) && !has(own, value.first));
  });
  return values;
}

}  // namespace porttape
