#include "daemon/channel_check.hpp"

#include <filesystem>
#include <fmt/format.h>
#include <system_error>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {
namespace {

using Owners = std::map<std::string, std::string>;  // what only one channel can have, and which has it

// One spelling for one place, as far as its folders are there.
std::string place(const std::string& path) {
  std::error_code error;
  const std::filesystem::path absolute = std::filesystem::absolute(path, error);
  const std::filesystem::path folder = std::filesystem::weakly_canonical(absolute.parent_path(), error);
  return ((error ? absolute.parent_path() : folder) / absolute.filename()).lexically_normal().string();
}

std::optional<Error> claim(Owners& owners, const PortType::Claim& wanted, const std::string& channel) {
  const auto& [kind, where] = wanted;
  const bool is_path = kind == "link" || kind == "socket" || kind == "tape" || kind == "report";
  const std::string at = is_path ? in_quotes(place(where)) : where;
  const auto [owner, free] = owners.emplace(kind + " " + at, channel);
  if (free) return std::nullopt;
  if (owner->second == channel)
    return make_error(Errc::usage, fmt::format("{} {} is there twice; name another", kind, at));
  return make_error(Errc::usage, fmt::format("{} {} is that of channel {}; name another", kind, at,
                                             in_quotes(owner->second)));
}

}  // namespace

std::vector<ChannelProblem> check_channels(const std::map<std::string, ChannelSpec>& channels) {
  std::vector<ChannelProblem> problems;
  Owners owners;
  for (const auto& [name, spec] : channels) {
    const ReadChannel read = read_channel(spec);
    for (const OptionProblem& problem : read.problems) problems.push_back({name, problem});
    for (const auto& [option, port] :
         {std::pair{"driver", &read.driver}, std::pair{"device", &read.device}}) {
      if (!*port) continue;
      for (const PortType::Claim& wanted : (*port)->type().claims(**port)) {
        if (const auto taken = claim(owners, wanted, name))
          problems.push_back({name, {spec.values.contains(wanted.first) ? wanted.first : option, *taken}});
      }
    }
  }
  return problems;
}

}  // namespace porttape
