#pragma once

#include <array>
#include <memory>

#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// Whether the files of a new tape can be made: see TapeWriter::check().
Result<void> check_tape_files(const TapePaths& paths, bool overwrite);

// The three files of a new tape, empty, which go away with this object unless publish() has kept them. Files
// that are to be replaced are untouched until then: the new ones have other names in the same folder.
class NewTapeFiles {
 public:
  // Errc::usage as check_tape_files(), Errc::io; an error leaves no new file behind.
  static Result<NewTapeFiles> make(const TapePaths& paths, bool overwrite);
  NewTapeFiles(NewTapeFiles&& other) noexcept;
  NewTapeFiles& operator=(NewTapeFiles&&) = delete;
  ~NewTapeFiles();

  // Gives each file its name, in place of an existing one. Errc::io.
  Result<void> publish();

  TapeSinks sinks;  // to be taken; they need not outlive this object

 private:
  struct Entry;
  using Entries = std::array<Entry, 3>;
  NewTapeFiles();

  std::unique_ptr<Entries> entries_;
};

}  // namespace porttape
