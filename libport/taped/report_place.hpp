#pragma once

#include <string>

#include "libport/base/result.hpp"

namespace porttape {

// What stands at the name of a report or a log, links followed.
struct ReportPlace {
  enum class Kind {
    replaced,   // nothing or a regular file
    written,    // a pipe, a terminal, a device: as it is
    descriptor  // of a process (/dev/stderr): written to whatever it is
  };
  std::string file;  // behind all links
  Kind kind = Kind::replaced;
};

// Follows the links that are the user's own or root's. Errc::io for another's.
Result<ReportPlace> find_report_place(const std::string& path);

}  // namespace porttape
