#include "tools/verb_advice.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/catalog/port_guess.hpp"
#include "libport/tape/tape_name.hpp"
#include "tools/option_description.hpp"

namespace porttape {
namespace {

constexpr std::string_view kTool = "porttape";
constexpr std::string_view kDaemon = "porttaped";

using Words = std::vector<std::string>;

bool contains(std::span<const std::string_view> words, std::string_view word) {
  return std::ranges::find(words, word) != words.end();
}

bool is_configuration(const std::string& word) {
  std::error_code error;
  return word.ends_with(".conf") || word.ends_with(".ini") || std::filesystem::is_regular_file(word, error);
}

// A tape that is there, or what looks like the name of one.
bool is_tape(const std::string& word) {
  constexpr std::array<std::string_view, 4> ends = {".log", ".logr", ".logw", ".loge"};
  return std::ranges::any_of(ends, [&](std::string_view end) { return word.ends_with(end); }) ||
         (!word.empty() && find_tape(word));
}

// The whole line that a first word stands for that is no verb.
std::string line_for(std::string_view program, const std::string& word) {
  if (is_tape(word))
    return program == kTool ? shell_line(Words{std::string(kTool), "info", word}) : replay_line(word);
  if (looks_like_port(word)) return record_line(word);
  return is_configuration(word) ? shell_line(Words{std::string(kDaemon), "run", word}) : "";
}

std::string accepted(std::span<const std::string_view> verbs) {
  return fmt::format("accepted: {}", fmt::join(verbs, ", "));
}

std::string of_other_program(std::string_view other, std::span<const std::string> arguments) {
  Words line{std::string(other)};
  line.insert(line.end(), arguments.begin(), arguments.end());
  return fmt::format("'{}' is a verb of {}: {}", arguments.front(), other, shell_line(line));
}

// "--help" and its like, for a word that was to be one of them.
std::string program_option(const std::string& word) {
  constexpr std::array<std::string_view, 3> known = {"--help", "--help-ports", "--version"};
  const bool is_version = word == "-v" || word == "-V";
  return did_you_mean(is_version ? "--version" : word.starts_with('-') ? word : "--" + word, known);
}

// An option where a verb is wanted: one of the program's, or one that belongs behind the verb.
std::string stray_option(std::string_view program, std::span<const std::string> arguments,
                         std::span<const std::string_view> verbs) {
  const std::string& option = arguments.front();
  const auto verb =
      std::ranges::find_if(arguments, [&](const std::string& word) { return contains(verbs, word); });
  if (verb != arguments.end()) {
    Words line{std::string(program), *verb};
    line.insert(line.end(), arguments.begin(), verb);
    line.insert(line.end(), verb + 1, arguments.end());
    return fmt::format("{} belongs behind the verb: {}", in_quotes(option), shell_line(line));
  }
  if (const std::string guess = program_option(option); !guess.empty())
    return fmt::format("unknown option {}{}", in_quotes(option), guess);
  return with_help(fmt::format("a verb is missing before {}; {}", in_quotes(option), accepted(verbs)),
                   program);
}

}  // namespace

std::string device_for(std::string_view text) {
  std::string meant = meant_port(text, LineEnd::device);
  return meant.empty() ? "/dev/ttyUSB0" : meant;
}

std::string record_line(std::string_view device) {
  return shell_line(Words{std::string(kDaemon), "record", "--device", device_for(device), "--driver",
                          "pty:/tmp/port", "--tape", "NAME"});
}

std::string replay_line(std::string_view tape) {
  return shell_line(
      Words{std::string(kDaemon), "replay", "--tape", std::string(tape), "--driver", "pty:/tmp/port"});
}

std::string no_verb(std::string_view program, std::span<const std::string> arguments) {
  const bool tool = program == kTool;
  const std::span<const std::string_view> own =
      tool ? std::span<const std::string_view>(kToolVerbs) : std::span<const std::string_view>(kDaemonVerbs);
  const std::span<const std::string_view> others =
      tool ? std::span<const std::string_view>(kDaemonVerbs) : std::span<const std::string_view>(kToolVerbs);
  const std::string_view other = tool ? kDaemon : kTool;
  if (arguments.empty()) return with_help(fmt::format("a verb is missing; {}", accepted(own)), program);
  const std::string& word = arguments.front();
  if (word.starts_with('-')) return stray_option(program, arguments, own);
  if (contains(others, word)) return of_other_program(other, arguments);
  const std::string what = fmt::format("unknown verb {}", in_quotes(word));
  if (const std::string guess = did_you_mean(word, own); !guess.empty()) return what + guess;
  if (const std::string line = line_for(program, word); !line.empty())
    return fmt::format("{}; did you mean {}?", what, in_quotes(line));
  if (const std::string guess = program_option(word); !guess.empty()) return what + guess;
  if (const auto verb = nearest(word, others))
    return fmt::format("{}; did you mean '{} {}'?", what, other, *verb);
  return with_help(fmt::format("{}; {}", what, accepted(own)), program);
}

}  // namespace porttape
