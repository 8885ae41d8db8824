#pragma once

#include <string>
#include <string_view>
#include <sys/types.h>

#include "libport/base/result.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// Where a report goes, by what stands at `path`:
// - nothing or a regular file: a new file takes its place in one step, so that a reader sees the old report
//   or the new one, and what the old name led to (a hard link, an open file) is left alone;
// - a symbolic link: what it leads to is treated so, if the link and its target are the user's own or root's;
//   anybody else's link is an error, also one that leads to a folder on the way;
// - a pipe, a terminal, a device, and whatever /dev/stderr and /dev/fd/N lead to: written to as it is.
// `-` is stdout.

// Whether a report can be written there later. Errc::usage.
// `what` it is, for messages.
Result<void> check_report_place(const std::string& path, std::string_view what = "report");

// Whether a report would replace nothing there but what the user lets it: without `overwrite` no file, and
// never a tape that is being written, nor `input`, which the program reads. Errc::usage.
Result<void> check_report_free(const std::string& path, bool overwrite, const std::string& input);

// Whether a report there would leave the tape alone, whatever name leads to its files. Errc::usage.
Result<void> check_report_apart(const std::string& path, const TapePaths& tape);

// Whether the two reports of a run go to two places (is_same_report_place()). Errc::usage.
Result<void> check_reports_apart(const std::string& report, const std::string& junit);

// What the report is made of may be `kept` from the group and from others (kept_from_others()), and then is
// the report, unless it goes to a place that is written to as it is.
// Waits for the disk, and up to a second for the reader of a pipe or terminal: who has a line to serve calls
// it from another thread.
Result<void> write_report(const std::string& path, std::string_view text, std::string_view what = "report",
                          mode_t kept = 0);

}  // namespace porttape
