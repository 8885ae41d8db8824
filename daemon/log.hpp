#pragma once

#include <functional>
#include <memory>
#include <string>

#include <spdlog/logger.h>

#include "libport/base/result.hpp"

namespace porttape {

// The program's log. Whoever logs never waits for it, see LogQueue.
struct Log {
  std::shared_ptr<spdlog::logger> logger;
  std::function<void()> reopen;  // the file, by its name
  std::string place;             // where it goes, when that is not stderr: "the journal", a file's name
};

// Where a log goes.
struct LogPlace {
  std::string file;         // empty: stderr
  bool background = false;  // without a file: the journal or syslog, else a file of the user's state folder
  std::string journal = "/run/systemd/journal/socket";
  std::string syslog = "/dev/log";
};

// stderr has colours on a terminal and priorities where it is the journal. Errc::usage: a file that cannot be
// written.
Result<Log> make_log(const LogPlace& place, spdlog::level::level_enum level);

}  // namespace porttape
