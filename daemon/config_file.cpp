#include "daemon/config_file.hpp"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <string_view>
#include <utility>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/options_description.hpp>
#include <boost/program_options/parsers.hpp>

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::string_view kSection = "channel ";

ChannelMode mode_of(const ChannelSpec& channel) {
  const bool device = channel.values.contains("device");
  const bool tape = channel.values.contains("tape");
  if (device) return tape ? ChannelMode::record : ChannelMode::bridge;
  return tape ? ChannelMode::replay : ChannelMode::bridge;
}

// "channel laser.device" → laser, device. Option names have no dot, channel names may.
Result<std::pair<std::string, std::string>> split_key(const std::string& key) {
  const std::size_t dot = key.rfind('.');
  if (!key.starts_with(kSection) || dot == std::string::npos || dot <= kSection.size()) {
    return make_error(Errc::usage, fmt::format("'{}' is not in a section [channel NAME]", key));
  }
  return std::pair{key.substr(kSection.size(), dot - kSection.size()), key.substr(dot + 1)};
}

Result<std::map<std::string, ChannelSpec>> channels_of(const po::parsed_options& parsed) {
  std::map<std::string, ChannelSpec> channels;
  for (const po::option& option : parsed.options) {
    const auto key = split_key(option.string_key);
    if (!key) return key.error();
    const std::string value = option.value.empty() ? std::string() : option.value.front();
    if (!channels[key->first].values.emplace(key->second, value).second) {
      return make_error(Errc::usage,
                        fmt::format("channel '{}': '{}' is there twice", key->first, key->second));
    }
  }
  if (channels.empty())
    return make_error(Errc::usage, "there is no section [channel NAME] with options in it");
  for (auto& [name, channel] : channels) {
    channel.mode = mode_of(channel);
    // A daemon that comes up again after a reboot finds its last tape.
    if (channel.mode == ChannelMode::record && !channel.values.contains("overwrite"))
      channel.values.try_emplace("on-existing", "next");
  }
  return channels;
}

}  // namespace

Result<std::map<std::string, ChannelSpec>> read_config(std::istream& in, const std::string& name) {
  try {
    const po::options_description none;
    Result<std::map<std::string, ChannelSpec>> channels = channels_of(po::parse_config_file(in, none, true));
    if (channels) return channels;
    return make_error(Errc::usage, fmt::format("configuration '{}': {}", name, channels.error().message));
  } catch (const po::invalid_config_file_syntax& error) {
    // Not its what(), which never ends where the line has the name of one of its placeholders in it.
    return make_error(Errc::usage,
                      fmt::format("configuration '{}': '{}' is neither NAME = VALUE nor [channel NAME]", name,
                                  error.tokens()));
  } catch (const po::error& error) {
    return make_error(Errc::usage, fmt::format("configuration '{}': {}", name, error.what()));
  }
}

Result<std::map<std::string, ChannelSpec>> read_config_file(const std::string& path) {
  std::error_code error;
  std::ifstream file(path);
  if (std::filesystem::is_directory(path, error)) errno = EISDIR;
  if (!file || std::filesystem::is_directory(path, error)) {
    return make_error(Errc::usage, fmt::format("configuration '{}': {}", path, errno_text(errno)));
  }
  return read_config(file, path);
}

}  // namespace porttape
