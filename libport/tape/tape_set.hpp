#pragma once

#include <memory>
#include <string>
#include <vector>

#include "libport/base/own_name.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/tape/leftover.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// Tapes of one folder that appear together, or none of them. Each is made, by NewTape, where place() says: in
// a hidden folder beside them, so that any number of finished ones costs no descriptor. publish() gives them
// their names; only then they replace what has those, and keep from others what that does. The folder goes
// away with this object, and by the signals of Leftover; SIGKILL leaves it, `.NAME.XXXXXX`.
class TapeSet {
 public:
  // In the folder of `first`, to which no other user's link may lead. Errc::usage.
  static Result<TapeSet> begin(const TapePaths& first, OnExisting on_existing);

  // Where a tape is to be made. Errc::usage: its name is taken, or it is being written.
  Result<TapePaths> place(const TapePaths& tape);

  // All for which place() was asked, which are finished by now. Errors as of place(), Errc::io: none of them
  // is there then, and what they were to replace is (but on a file system that cannot exchange two files).
  Result<void> publish();

 private:
  struct Moved {
    std::string from;  // both relative to `parent_`
    std::string to;
    FileIdentity file;
    bool exchanged = false;
  };
  TapeSet(UniqueFd parent, Leftover folder, OnExisting on_existing)
      : parent_(std::move(parent)), folder_(std::move(folder)), on_existing_(on_existing) {}
  [[nodiscard]] TapePaths hidden(const TapePaths& tape) const;
  [[nodiscard]] Result<void> check_free(const TapePaths& tape) const;
  Result<void> move(const std::filesystem::path& tape_file);
  void undo();

  UniqueFd parent_;
  Leftover folder_;  // in there
  OnExisting on_existing_;
  std::vector<TapePaths> tapes_;
  std::vector<Moved> moved_;
};

}  // namespace porttape
