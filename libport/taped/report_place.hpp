#pragma once

#include <string>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// What stands at the name of a report or a log, links followed.
struct ReportPlace {
  enum class Kind {
    replaced,   // nothing or a regular file
    written,    // a pipe, a terminal, a device: as it is
    descriptor  // of a process (/dev/stderr): written to whatever it is
  };
  UniqueFd folder;   // that it is in, opened (O_PATH)
  std::string name;  // there, behind all links
  std::string file;  // the path, for messages
  Kind kind = Kind::replaced;
};

// Follows the links that are the user's own or root's, those of folders on the way too. The descriptor and
// the name mean that place even if somebody exchanges a folder on the way. Errc::io: there is another's link,
// or no such folder.
Result<ReportPlace> find_report_place(const std::string& path);

// Returns whether two names mean one place, so that a second report would replace the first or follow it in
// one stream. `-` is stdout. Returns false for /dev/null and for a name whose place cannot be found.
bool is_same_report_place(const std::string& one, const std::string& other);

}  // namespace porttape
