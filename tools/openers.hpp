#pragma once

#include <map>
#include <set>
#include <string>
#include <sys/types.h>
#include <vector>

namespace porttape {

// A process that has a file open.
struct Opener {
  pid_t pid = 0;
  std::string name;
};

// Who has these files open, by path, as far as /proc lets us see: our user's processes, everybody's for root;
// this one is left out. `proc` is another folder in tests.
std::map<std::string, std::vector<Opener>> openers_of(const std::set<std::string>& paths,
                                                      const std::string& proc = "/proc");

}  // namespace porttape
