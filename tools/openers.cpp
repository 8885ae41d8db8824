#include "tools/openers.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <system_error>
#include <unistd.h>

#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// Those of `paths` that the process has open.
std::set<std::string> open_of(const fs::path& process, const std::set<std::string>& paths) {
  std::set<std::string> found;
  std::error_code hidden;
  for (fs::directory_iterator fd(process / "fd", hidden), end; !hidden && fd != end; fd.increment(hidden)) {
    std::error_code gone;
    const std::string target = fs::read_symlink(fd->path(), gone).string();
    if (paths.contains(target)) found.insert(target);
  }
  return found;
}

}  // namespace

std::map<std::string, std::vector<Opener>> openers_of(const std::set<std::string>& paths,
                                                      const std::string& proc) {
  std::map<std::string, std::vector<Opener>> openers;
  if (paths.empty()) return openers;
  std::error_code hidden;
  for (fs::directory_iterator process(proc, hidden), end; !hidden && process != end;
       process.increment(hidden)) {
    const auto pid = whole_number<pid_t>(process->path().filename().string());
    if (!pid || *pid == ::getpid()) continue;
    for (const std::string& path : open_of(process->path(), paths)) {
      std::string name;
      std::ifstream comm(process->path() / "comm");
      std::getline(comm, name);
      openers[path].push_back({*pid, name});
    }
  }
  for (auto& [path, list] : openers) std::ranges::sort(list, {}, &Opener::pid);
  return openers;
}

}  // namespace porttape
