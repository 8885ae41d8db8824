#pragma once

#include <string>

namespace porttape {

// What a command would have by its file and does not get while its calls are supervised (no_new_privs), in
// words: whose rights, and what to do. Empty: it loses none, as far as can be seen. The command is found as
// execvp() finds it.
std::string lost_rights(const std::string& command);

}  // namespace porttape
