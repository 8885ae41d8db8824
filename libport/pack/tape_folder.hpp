#pragma once

#include <filesystem>
#include <memory>
#include <utility>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// The folder that a tape is in, kept open. A pack is sent to others, and the tape may be in a stranger's
// folder: a link there must not add one of this user's files to the pack, whenever the stranger makes it.
class TapeFolder {
 public:
  // Errc::usage: there is no such folder.
  static Result<TapeFolder> open(const TapePaths& tape);

  // Opens a file of the tape, which is a file of this folder; null: it is not there. A link is followed to
  // another name of the folder. Errc::usage: a link leads out of it, or as FileSource::open().
  [[nodiscard]] Result<std::unique_ptr<FileSource>> open_file(const std::filesystem::path& path) const;

 private:
  explicit TapeFolder(UniqueFd folder) : folder_(std::move(folder)) {}
  [[nodiscard]] bool holds(const std::filesystem::path& target) const;

  UniqueFd folder_;
};

}  // namespace porttape
