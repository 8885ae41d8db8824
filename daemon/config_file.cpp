#include "daemon/config_file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "daemon/channel_check.hpp"
#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr std::size_t kLargest = std::size_t{1} << 20;  // bytes of a file

constexpr std::string_view kSection = "channel";
constexpr std::size_t kMostTold = 20;  // of what is no configuration, nobody wants to read every line

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view space = " \t\r\n";
  const std::size_t begin = text.find_first_not_of(space);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(space) - begin + 1);
}

ChannelMode mode_of(const ChannelSpec& channel) {
  const bool device = channel.values.contains("device");
  const bool tape = channel.values.contains("tape");
  if (device) return tape ? ChannelMode::record : ChannelMode::bridge;
  return tape ? ChannelMode::replay : ChannelMode::bridge;
}

// Reads line by line and goes on after what is wrong. Use: read(), then finish().
class ConfigReader {
 public:
  explicit ConfigReader(std::string name) : name_(std::move(name)) {}

  void read(std::istream& in) {
    std::string text;
    for (line_ = 1; std::getline(in, text); ++line_) {
      constexpr std::string_view mark = "\xEF\xBB\xBF";  // of UTF-8, as some editors write it
      std::string_view line = text;
      if (line_ == 1 && line.starts_with(mark)) line.remove_prefix(mark.size());
      if (line.find('\0') != std::string_view::npos) {
        problems_.clear();
        channels_.clear();
        return tell(line_, "is not text; accepted: an INI file, see porttaped run --help");
      }
      read_line(trimmed(line.substr(0, line.find('#'))));
    }
  }

  Result<std::map<std::string, ChannelSpec>> finish() {
    if (channels_.empty() && problems_.empty()) tell(1, "there is no section [channel NAME]");
    for (auto& [name, channel] : channels_) {
      channel.mode = mode_of(channel);
      // A daemon that comes up again after a reboot finds its last tape.
      if (channel.mode == ChannelMode::record && !channel.values.contains("overwrite"))
        channel.values.try_emplace("on-existing", "next");
    }
    for (const auto& [channel, problem] : check_channels(channels_)) {
      const auto& lines = lines_.at(channel);
      const auto key = lines.find(problem.option);
      tell(key == lines.end() ? lines.at("") : key->second, problem.error.message);
    }
    if (problems_.empty()) return std::move(channels_);
    return all_problems();
  }

 private:
  void read_line(std::string_view line) {
    if (line.empty() || line.starts_with(';')) return;
    if (line.starts_with('[') && line.ends_with(']')) return begin_section(line);
    const std::size_t equals = line.find('=');
    const std::string key(trimmed(line.substr(0, equals)));
    if (equals == std::string_view::npos || key.empty())
      return tell(line_, fmt::format("{} is neither KEY = VALUE nor [channel NAME]", in_quotes(line)));
    if (skips_) return;
    if (section_.empty())
      return tell(line_, fmt::format("{} is in no section; write [channel NAME] above it", in_quotes(key)));
    if (const auto [at, is_new] = lines_.at(section_).emplace(key, line_); !is_new)
      return tell(line_,
                  fmt::format("option {} is there twice, first in line {}", in_quotes(key), at->second));
    channels_.at(section_).values.emplace(key, trimmed(line.substr(equals + 1)));
  }

  void begin_section(std::string_view line) {
    const std::string_view inside = trimmed(line.substr(1, line.size() - 2));
    const std::size_t end = std::min(inside.find_first_of(" \t"), inside.size());
    const std::string_view kind = inside.substr(0, end);
    const std::string name(trimmed(inside.substr(end)));
    skips_ = true;  // unless it is good
    if (kind != kSection || name.empty()) return wrong_section(line, kind, name);
    if (const auto known = lines_.find(name); known != lines_.end())
      return tell(line_, fmt::format("channel {} is there twice, first in line {}", in_quotes(name),
                                     known->second.at("")));
    skips_ = false;
    section_ = name;
    channels_.emplace(name, ChannelSpec());
    lines_[name].emplace("", line_);
  }

  void wrong_section(std::string_view line, std::string_view kind, const std::string& name) {
    std::string guess = "; accepted: [channel NAME]";
    constexpr std::array<std::string_view, 1> known = {kSection};
    if (!kind.empty() && kind != kSection && name.empty())
      guess = fmt::format("; did you mean '[channel {}]'?", kind);
    if (kind != kSection && !name.empty() && nearest(kind, known))
      guess = fmt::format("; did you mean '[channel {}]'?", name);
    tell(line_, fmt::format("{} is no section{}", in_quotes(line), guess));
  }

  void tell(std::size_t line, std::string what) { problems_.emplace_back(line, std::move(what)); }

  Error all_problems() {
    std::ranges::stable_sort(problems_, {}, &std::pair<std::size_t, std::string>::first);
    std::string all;
    for (std::size_t n = 0; n < std::min(problems_.size(), kMostTold); ++n) {
      all += fmt::format("{}{}:{}: {}", n == 0 ? "" : "\n", printable_line(name_), problems_[n].first,
                         printable_line(problems_[n].second));
    }
    if (problems_.size() > kMostTold)
      all += fmt::format("\nand {} more of the kind", problems_.size() - kMostTold);
    return make_error(Errc::usage, all);
  }

  std::string name_;
  std::size_t line_ = 0;
  std::string section_;
  bool skips_ = false;  // the keys of a section that is wrong
  std::map<std::string, ChannelSpec> channels_;
  // By channel and key, the section's own as "".
  std::map<std::string, std::map<std::string, std::size_t>> lines_;
  std::vector<std::pair<std::size_t, std::string>> problems_;
};

}  // namespace

Result<std::map<std::string, ChannelSpec>> read_config(std::istream& in, const std::string& name) {
  ConfigReader reader(name);
  reader.read(in);
  return reader.finish();
}

Result<std::map<std::string, ChannelSpec>> read_config_file(const std::string& path) {
  std::error_code error;
  std::ifstream file(path);
  if (std::filesystem::is_directory(path, error)) errno = EISDIR;
  if (!file || std::filesystem::is_directory(path, error)) {
    return make_error(Errc::usage,
                      fmt::format("configuration {}: {}; name an INI file, see porttaped run --help",
                                  in_quotes(path), errno_text(errno)));
  }
  // It may have no end.
  std::string text(kLargest + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kLargest) {
    return make_error(
        Errc::usage,
        fmt::format("configuration {} has more than a megabyte; is it an INI file?", in_quotes(path)));
  }
  std::istringstream in(text);
  return read_config(in, path);
}

}  // namespace porttape
