#pragma once

#include <string>
#include <sys/types.h>
#include <vector>

namespace porttape {

// The rights of a supervised thread, for what is done in its name: porttape may have more, and a driver may
// have given up its own. What cannot be seen is taken for a right that the thread has not.
//
// What is done in a driver's name, and by which rights (a new one has its line here):
//   the files of `exec --tap` that it opens         why_not_ours(): else it opens them itself
//   TIOCSSERIAL under `exec` (UartModel)            is_administrator()
//   all other requests to its line                  its open descriptor

// Why a file that the thread opens is not for us to open: its user, groups, capabilities, user namespace or
// security label are others than ours, or the files that it sees are. Empty: it would open what we do, as far
// as /proc shows that, which does not show Landlock (TapCalls sees a program restrict itself by that).
std::string why_not_ours(pid_t thread);

// The process of a thread and those that it descends from, as far as /proc shows them: of an orphan's
// ancestors none is known.
std::vector<pid_t> lineage_of(pid_t thread);

// Whether the thread may do here what the kernel asks CAP_SYS_ADMIN for.
bool is_administrator(pid_t thread);

}  // namespace porttape
