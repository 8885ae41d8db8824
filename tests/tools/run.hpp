#pragma once

#include <re2/re2.h>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"
#include "tools/verbs.hpp"

namespace porttape::test {

struct Ran {
  int status = 0;
  std::string out;
  std::string err;
};

// A report, or what a suite prints, without what it adds where the machine stood still for a moment.
inline std::string without_doubts(std::string report) {
  RE2::GlobalReplace(&report, "(?m)^pass, with doubts  .*\n(?:    doubt     .*\n)+|^# doubt: .*\n", "");
  RE2::GlobalReplace(&report, " \\(\\d+ with doubts\\)", "");
  RE2::GlobalReplace(&report, "(?m), with doubts|^  doubt     .*\n", "");
  return report;
}

inline Ran run_with_doubts(const std::vector<std::string>& args) {
  std::ostringstream out;
  std::ostringstream err;
  const int status = run_porttape(args, out, err);
  return {status, out.str(), err.str()};
}

inline Ran run(const std::vector<std::string>& args) {
  Ran ran = run_with_doubts(args);
  ran.out = without_doubts(std::move(ran.out));
  return ran;
}

inline constexpr std::string_view kEventsHeader =
    R"({"format":"porttape-events","version":1,"created":"2024-05-06T07:08:09Z","device":"serial:/dev/ttyUSB0",)"
    R"("driver":"pty:/tmp/x","host":"bench","tool":"porttape 0.1.0"})"
    "\n";

// Writes a tape into `dir` and gives its name.
inline std::string make_tape(const TempDir& dir, const std::string& name, const std::vector<Block>& read,
                             const std::vector<Block>& write, const std::string& events = "") {
  write_file(dir / (name + ".logr"), block_bytes(read));
  write_file(dir / (name + ".logw"), block_bytes(write));
  if (!events.empty()) write_file(dir / (name + ".loge"), bytes_of(std::string(kEventsHeader) + events));
  return dir / (name + ".log");
}

}  // namespace porttape::test
