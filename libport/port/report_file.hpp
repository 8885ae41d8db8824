#pragma once

#include <string>
#include <string_view>

#include "libport/base/result.hpp"

namespace porttape {

// Whether a report can be written there later: a folder that exists, no folder in its place. Errc::usage.
Result<void> check_report_place(const std::string& path);

// Replaces the file in one step, so that a reader sees the old report or the new one. `-` is stdout.
Result<void> write_report(const std::string& path, std::string_view text);

}  // namespace porttape
