#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "libport/formats/format.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape::test {

// A tape in another form, and what that cannot hold.
inline std::string exported(const TapePaths& tape, std::string_view format,
                            std::vector<std::string>* losses = nullptr) {
  auto reader = TapeReader::open(tape);
  if (!reader) throw std::runtime_error(reader.error().message);
  NewFile file = NewFile::in_memory();
  const auto lost = find_format(format)->export_tape(*reader, file, {});
  if (!lost) throw std::runtime_error(lost.error().message);
  if (losses != nullptr) *losses = *lost;
  if (const auto done = file.finish(); !done) throw std::runtime_error(done.error().message);
  return file.take();
}

// The tape `name` in `dir`, made of evidence.
inline Result<ImportedTape> imported(const TempDir& dir, const std::string& name, std::string_view format,
                                     std::string_view evidence, const ImportOptions& options = {}) {
  Evidence from = Evidence::of("evidence", evidence);
  ImportTape tape(new_tape(dir / name), {.sync = false}, options, "evidence");
  const auto end = find_format(format)->import_tape(from, tape, {});
  if (!end) return end.error();
  return tape.finish(*end);
}

// What is on it, or why there is none.
inline std::vector<std::string> lines_of(const Result<ImportedTape>& tape) {
  if (!tape) return {"error: " + tape.error().message};
  return lines_on(tape->paths);
}

// The same without the marks of what was guessed.
inline std::vector<std::string> told_lines(const Result<ImportedTape>& tape) {
  std::vector<std::string> lines = lines_of(tape);
  std::erase_if(lines, [](const std::string& line) { return line.find("\"convert: ") != std::string::npos; });
  return lines;
}

inline std::string header_line_of(const TapePaths& paths) {
  const auto reader = TapeReader::open(paths);
  return reader ? reader->header_line() : reader.error().message;
}

}  // namespace porttape::test
