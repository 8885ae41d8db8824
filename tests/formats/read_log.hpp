#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tests/formats/convert_tape.hpp"

namespace porttape::test {

// What became of evidence: the tape's records, one line each, without the marks of what was guessed.
struct ReadLog {
  std::vector<std::string> lines;
  std::vector<std::string> guesses;
  std::vector<std::string> problems;
  std::string error;
};

inline ReadLog read_log(const TempDir& dir, std::string_view format, std::string_view text,
                        const ImportOptions& options = {}) {
  Evidence evidence = Evidence::of("evidence", text);
  ImportTape tape(literal_tape(dir / "imported"), {.on_existing = OnExisting::overwrite, .sync = false},
                  options, "evidence");
  const auto end = find_format(format)->import_tape(evidence, tape, {});
  if (!end) return {{}, {}, {}, end.error().message};
  const auto made = tape.finish(*end);
  if (!made) return {{}, {}, {}, made.error().message};
  ReadLog result{{}, made->guesses, made->problems, {}};
  for (const std::string& line : lines_on(made->paths)) {
    if (line.find("\"convert: ") == std::string::npos) result.lines.push_back(line);
  }
  return result;
}

// The format that evidence is taken for; empty: none.
inline std::string_view detected(std::string_view text) {
  const Format* const format = detect_format(text, "x");
  return format == nullptr ? std::string_view() : format->name;
}

}  // namespace porttape::test
