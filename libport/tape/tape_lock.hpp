#pragma once

#include <cstdint>
#include <filesystem>

#include "libport/tape/tape_name.hpp"

namespace porttape {

// The lock of one file of a tape (FORMAT.md, "Locks"). It belongs to the open file, so that two tapes of one
// process exclude each other too, and ends when the descriptor and its duplicates are closed.
enum class TapeLock : std::uint8_t {
  held,   // now, by this descriptor; also where the file system has no locks
  taken,  // somebody else has it
  read,   // somebody has a lock to read it, which no recorder takes and who may only read it can
  moved,  // the name means another file by now, or none
  failed  // errno says why
};

// Locks a file that is open for writing, and makes sure that `name` in `folder` still means it. Never waits.
TapeLock lock_tape_file(int fd, int folder, const std::filesystem::path& name);

// Whether a recorder has one of the tape's files locked. Takes nothing, so it is in nobody's way.
bool is_being_written(const TapePaths& paths);
bool is_being_written(const std::filesystem::path& file);  // one of them
bool is_being_written(int fd);                             // one that is open for reading

}  // namespace porttape
