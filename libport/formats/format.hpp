#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "libport/formats/evidence.hpp"
#include "libport/formats/import_tape.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {

// Told how many bytes of the input were read so far.
using ConvertProgress = std::function<void(std::uint64_t bytes)>;

// Puts all that the evidence tells on the tape, without its finish(); gives the time of its end, nothing
// where it tells that there is none. Evidence that is no such format at all is Errc::not_a_tape, what is
// wrong further on Errc::damaged_tape with its place (Evidence::error_at) where nothing sensible can be made
// of the rest, else a problem() of the tape.
using ImportFunction = Result<std::optional<TapeTime>> (*)(Evidence& from, ImportTape& to,
                                                           const ConvertProgress& progress);

// Writes a tape, without the file's finish(). Gives what the format cannot hold and the tape has, each once.
using ExportFunction = Result<std::vector<std::string>> (*)(TapeReader& from, NewFile& to,
                                                            const ConvertProgress& progress);

// The same of a format that needs the line's speed, where the tape does not tell it.
using ExportAtFunction = Result<std::vector<std::string>> (*)(TapeReader& from, NewFile& to,
                                                              std::optional<unsigned> bytes_at,
                                                              const ConvertProgress& progress);

// Whether evidence that begins so is of this format: 0 no, to 100 for sure.
using DetectFunction = int (*)(std::string_view head);

// A form that evidence comes in, or goes to. A new one is a row of the table in format.cpp, its functions in
// files of its own, its round trip in tests/formats, and what it holds in FORMATS.md.
struct Format {
  std::string_view name;
  std::string_view what;       // a line of `porttape convert --formats`
  ImportFunction import_tape;  // null: it is only written
  ExportFunction export_tape;  // null: it is only read
  DetectFunction detect;       // null: is to be named
  std::string_view suffixes;   // that its files have, "txt text"
  ExportAtFunction export_at = nullptr;
};

std::span<const Format> formats();
const Format* find_format(std::string_view name);
// By how it begins, and where that tells nothing by the file's name. Null: that is not to be told.
const Format* detect_format(std::string_view head, std::string_view name);

}  // namespace porttape
