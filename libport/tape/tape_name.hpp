#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"

namespace porttape {

// The three files of a tape (contract section 1).
struct TapePaths {
  std::filesystem::path read;
  std::filesystem::path write;
  std::filesystem::path events;

  // What a person calls the tape: the r file's path without its r.
  [[nodiscard]] std::string name() const;
  // Without its folder.
  [[nodiscard]] std::string file_name() const;
  friend bool operator==(const TapePaths&, const TapePaths&) = default;
};

// `file=X` of an option string: Xr, Xw, Xe, whatever exists.
TapePaths literal_tape(std::string_view name);

// A tape to be made from a command-line argument: gets `.log` when it has none. `laser.logr` and `laser.logw`
// name `laser.log`.
TapePaths new_tape(std::string_view argument);
// The same, of a name that a person gave. Errc::usage for one that is no tape's: a folder's (`out/`, `.`), a
// device's (`/dev/null`), none.
Result<TapePaths> named_new_tape(std::string_view argument);

// `laser.log`, `laser.2.log`, `laser.3.log`, …: the names of a tape that another has to make room for.
TapePaths numbered_tape(const TapePaths& first, unsigned number);

// `laser.1.log`, `laser.2.log`, …: the parts that a tape is split into.
TapePaths part_tape(const TapePaths& whole, std::uint64_t number);

// `laser.log`, `laser.c2.log`, `laser.c3.log`, …: the tapes of several connections of one driver's port.
TapePaths connection_tape(const TapePaths& first, unsigned connection);
// The connections of such a group that there are files of, ascending. Reads the folder.
std::vector<unsigned> recorded_connections(const TapePaths& first);

// An existing tape from a command-line argument: `laser.log`, `laser.logr`, `laser.logw` or `laser`; the
// literal `<arg>r` is tried first, then `<arg>.logr`. Errc::usage when there is none, with what was looked
// for.
Result<TapePaths> find_tape(std::string_view argument);

}  // namespace porttape
