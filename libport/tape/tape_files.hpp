#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// Whether the files of a new tape can be made: see TapeWriter::check().
Result<void> check_tape_files(const TapePaths& paths, OnExisting on_existing);

// The three files of a new tape, empty and locked, which go away with this object unless publish() has kept
// them. Files that are to be replaced are locked too, and untouched until then: the new ones have other names
// in the same folder. A file's name is thus only ever taken away from it by the one who holds its lock.
// The new ones keep from the group and from others what any of those files does, and what the options say.
//
// Files that appear when they are published have no name before (where the file system has none such: a
// hidden one), so that whoever is killed leaves nothing; and no lock, since nobody finds them. Their sinks
// are open until then.
class NewTapeFiles {
 public:
  enum class Appear : std::uint8_t { at_once, when_published };

  // Errc::usage as check_tape_files(), Errc::io; an error leaves no new file behind.
  static Result<NewTapeFiles> make(const TapePaths& paths, const TapeWriterOptions& options,
                                   Appear appear = Appear::at_once);
  NewTapeFiles(NewTapeFiles&& other) noexcept;
  NewTapeFiles& operator=(NewTapeFiles&&) = delete;
  ~NewTapeFiles();

  // Gives each file its name, in place of an existing one. Errc::io, Errc::usage where a name is taken by
  // now: none of the new ones is there then.
  Result<void> publish();

  // Removes what is not published. To be called before the sinks are closed, which unlocks the files.
  void discard();

  TapePaths paths;  // of the final names
  TapeSinks sinks;  // to be taken; they need not outlive this object

 private:
  struct Entry;
  using Entries = std::array<Entry, 3>;
  NewTapeFiles();
  static Result<NewTapeFiles> make_at(const TapePaths& paths, OnExisting on_existing, Appear appear,
                                      mode_t kept);

  std::unique_ptr<Entries> entries_;
};

}  // namespace porttape
