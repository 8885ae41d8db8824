#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

namespace porttape {

// The verbs of both programs, so that each can name the other's. The programs hold their tables against them.
inline constexpr std::array<std::string_view, 26> kToolVerbs = {
    "info",   "cat",    "record",  "test", "drive",  "bless", "exec",    "probe", "soak",
    "shrink", "verify", "recover", "cut",  "split",  "merge", "convert", "plot",  "view",
    "diff",   "stats",  "redact",  "pack", "unpack", "rules", "status",  "ctl"};
inline constexpr std::array<std::string_view, 4> kDaemonVerbs = {"record", "replay", "bridge", "run"};

// What a user probably wanted to type: a device as a port, and the lines for a device and for a tape.
std::string device_for(std::string_view text);
std::string record_line(std::string_view device);
std::string replay_line(std::string_view tape);

// Whether each of a program's verbs is in the list, and the other way round.
template <class Verbs, class Names>
constexpr bool same_names(const Verbs& verbs, const Names& names) {
  if (std::size(verbs) != std::size(names)) return false;
  for (const auto& verb : verbs) {
    bool found = false;
    for (const std::string_view name : names) found = found || verb.name == name;
    if (!found) return false;
  }
  return true;
}

// What to say of arguments that do not begin with a verb of `program` (porttape or porttaped): what they
// begin with instead, and the line that was probably meant.
std::string no_verb(std::string_view program, std::span<const std::string> arguments);

}  // namespace porttape
