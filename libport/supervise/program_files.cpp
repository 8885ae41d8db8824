#include "libport/supervise/program_files.hpp"

#include <array>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>

#include "libport/supervise/pending_signals.hpp"

namespace porttape {
namespace {

// What is behind `prefix`, where the path is that or lies below it.
std::optional<std::string_view> below(std::string_view path, std::string_view prefix) {
  if (!path.starts_with(prefix)) return std::nullopt;
  path.remove_prefix(prefix.size());
  return path.empty() || path.front() == '/' ? std::optional(path) : std::nullopt;
}

}  // namespace

std::string path_here(pid_t thread, const std::string& path, int folder) {
  if (!path.starts_with('/')) {
    return folder == AT_FDCWD ? fmt::format("/proc/{}/cwd/{}", thread, path)
                              : fmt::format("/proc/{}/fd/{}/{}", thread, folder, path);
  }
  constexpr std::array<std::string_view, 3> kStandard{"/dev/stdin", "/dev/stdout", "/dev/stderr"};
  for (std::size_t fd = 0; fd < kStandard.size(); ++fd) {
    if (path == kStandard.at(fd)) return fmt::format("/proc/{}/fd/{}", thread, fd);
  }
  if (const auto rest = below(path, "/dev/fd")) return fmt::format("/proc/{}/fd{}", thread, *rest);
  if (const auto rest = below(path, "/proc/self"))
    return fmt::format("/proc/{}{}", process_of(thread), *rest);
  if (const auto rest = below(path, "/proc/thread-self"))
    return fmt::format("/proc/{}/task/{}{}", process_of(thread), thread, *rest);
  return path;
}

bool gets_terminal(pid_t thread) {
  std::ifstream file(fmt::format("/proc/{}/stat", thread));
  std::string text;
  std::getline(file, text);
  const std::size_t name_end = text.rfind(')');  // a name may have one, too
  if (name_end == std::string::npos) return false;
  std::istringstream behind(text.substr(name_end + 1));
  char state = '\0';
  long parent = 0;
  long group = 0;
  long session = 0;
  long terminal = 0;
  if (!(behind >> state >> parent >> group >> session >> terminal)) return false;
  return terminal == 0 && session == process_of(thread);
}

}  // namespace porttape
