#include "libport/tape/tape_name.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSuffix = ".log";

// "x.logr" without its last letter; nothing where that is none of r, w and e.
std::string_view without_letter(std::string_view name) {
  constexpr std::string_view kLetters = "rwe";
  if (name.size() < 2 || kLetters.find(name.back()) == std::string_view::npos) return {};
  return name.substr(0, name.size() - 1);
}

TapePaths with_part(const TapePaths& first, const std::string& part) {
  std::string name = first.name();
  const std::size_t stem = name.ends_with(kSuffix) ? name.size() - kSuffix.size() : name.size();
  return literal_tape(name.insert(stem, part));
}

// N of "PREFIXNSUFFIXr", 2 or more.
std::optional<unsigned> number_between(std::string_view name, std::string_view prefix,
                                       std::string_view suffix) {
  std::string_view digits = without_letter(name);
  if (!digits.starts_with(prefix)) return std::nullopt;
  digits.remove_prefix(prefix.size());
  if (!digits.ends_with(suffix)) return std::nullopt;
  digits.remove_suffix(suffix.size());
  const auto number = whole_number<unsigned>(digits);
  return number && *number >= 2 && digits[0] != '0' ? number : std::nullopt;
}

template <class Test>
bool either_file(const TapePaths& paths, Test test) {
  std::error_code ignored;
  return test(fs::status(paths.read, ignored)) || test(fs::status(paths.write, ignored));
}

// "; did you mean 'laser.log'?", where a tape of such a name is in the folder.
std::string near_tape(const fs::path& path) {
  constexpr std::size_t most = 1000;
  std::vector<std::string> names;
  std::error_code error;
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  for (fs::directory_iterator each(folder, error); !error && each != fs::directory_iterator();
       each.increment(error)) {
    const std::string name = each->path().filename().string();
    const std::string_view tape = without_letter(name);
    if (!tape.ends_with(kSuffix) || names.size() >= most) continue;
    names.emplace_back(tape);
    names.emplace_back(tape.substr(0, tape.size() - kSuffix.size()));
  }
  std::ranges::sort(names);
  const std::vector<std::string_view> known(names.begin(), names.end());
  const auto near = nearest(path.filename().string(), known);
  return near ? "; did you mean " + in_quotes((path.parent_path() / *near).string()) + "?" : "";
}

}  // namespace

std::string TapePaths::name() const {
  std::string text = read.string();
  if (!text.empty()) text.pop_back();
  return text;
}

std::string TapePaths::file_name() const { return fs::path(name()).filename().string(); }

TapePaths literal_tape(std::string_view name) {
  const std::string base(name);
  return {base + "r", base + "w", base + "e"};
}

TapePaths new_tape(std::string_view argument) {
  if (argument.ends_with(kSuffix)) return literal_tape(argument);
  const std::string_view base = without_letter(argument);
  if (base.ends_with(kSuffix)) return literal_tape(base);
  return literal_tape(std::string(argument).append(kSuffix));
}

Result<TapePaths> named_new_tape(std::string_view argument) {
  const fs::path path(argument);
  const fs::path file = path.filename();
  if (argument.empty()) return make_error(Errc::usage, "the name of the new tape is empty");
  if (file.empty() || file == "." || file == "..") {
    return make_error(Errc::usage,
                      in_quotes(argument) +
                          " is a folder, and a tape is several files in one; give a name in it, as in " +
                          in_quotes((path / "tape.log").string()));
  }
  std::error_code ignored;
  const fs::file_status there = fs::status(path, ignored);
  if (fs::is_character_file(there) || fs::is_block_file(there))
    return make_error(Errc::usage,
                      in_quotes(argument) + " is a device, which holds no tape; give another name");
  return new_tape(argument);
}

TapePaths numbered_tape(const TapePaths& first, unsigned number) {
  if (number <= 1) return first;
  return with_part(first, "." + std::to_string(number));
}

TapePaths part_tape(const TapePaths& whole, std::uint64_t number) {
  return with_part(whole, "." + std::to_string(number));
}

TapePaths connection_tape(const TapePaths& first, unsigned connection) {
  if (connection <= 1) return first;
  return with_part(first, ".c" + std::to_string(connection));
}

std::vector<unsigned> recorded_connections(const TapePaths& first) {
  std::set<unsigned> found;
  const auto is_there = [](const fs::path& path) {
    std::error_code ignored;
    return fs::exists(fs::symlink_status(path, ignored));
  };
  if (is_there(first.read) || is_there(first.write) || is_there(first.events)) found.insert(1);
  const std::string name = first.file_name();
  const std::string suffix(name.ends_with(kSuffix) ? kSuffix : std::string_view());
  const std::string prefix = name.substr(0, name.size() - suffix.size()) + ".c";
  std::error_code error;
  const fs::path folder = first.read.has_parent_path() ? first.read.parent_path() : fs::path(".");
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (const auto number = number_between(entry->path().filename().string(), prefix, suffix))
      found.insert(*number);
  }
  return {found.begin(), found.end()};
}

Result<TapePaths> find_tape(std::string_view argument) {
  if (argument.empty()) return make_error(Errc::usage, "the name of the tape is empty");
  const std::string name(argument);
  const std::array candidates{literal_tape(name), literal_tape(name + std::string(kSuffix)),
                              literal_tape(without_letter(name))};
  const std::size_t count = without_letter(name).empty() ? 2 : 3;

  // A folder or a device of the name must not hide a tape; where it is all there is, opening it says what is
  // wrong.
  for (std::size_t i = 0; i < count; ++i) {
    if (either_file(candidates.at(i), [](const fs::file_status& s) { return fs::is_regular_file(s); })) {
      return candidates.at(i);
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (either_file(candidates.at(i), [](const fs::file_status& s) { return fs::exists(s); })) {
      return candidates.at(i);
    }
  }
  std::error_code ignored;
  for (std::size_t i = 0; i < count; ++i) {
    if (const fs::path& read = candidates.at(i).read; fs::is_symlink(fs::symlink_status(read, ignored)))
      return make_error(Errc::usage, "no tape " + in_quotes(name) + ": there is only " +
                                         in_quotes(read.string()) + ", a link that leads nowhere");
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (const fs::path& events = candidates.at(i).events; fs::is_regular_file(events, ignored))
      return make_error(Errc::usage, "no tape " + in_quotes(name) + ": there is only " +
                                         in_quotes(events.string()) +
                                         ", the events of one whose r and w files are missing");
  }
  const bool is_there = fs::exists(fs::path(name), ignored);
  return make_error(Errc::usage, "no tape " + in_quotes(name) + ": there is neither " +
                                     in_quotes(candidates[0].read.string()) + " nor " +
                                     in_quotes(candidates[1].read.string()) +
                                     (is_there ? " (a tape's files end in r and w)" : "") + near_tape(name));
}

}  // namespace porttape
