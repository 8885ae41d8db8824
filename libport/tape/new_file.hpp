#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/tape/leftover.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// A file that appears under its name by finish(), whole, or not at all; `-` is stdout, which gets what is
// added as it comes. Owns its descriptor. Until then the file has no name, or where the file system knows no
// such files a hidden one beside its own. A tape that is being written is never replaced. After an error
// nothing more is written, and every further call gives it again. Not thread-safe.
//
// Its mode is 0640 less the umask, and less what the file that it replaces keeps from the group.
class NewFile {
 public:
  // Errc::usage: something has that name already (and is not to be replaced, is no regular file, or a tape
  // that is being written), another user's link leads there, or no file can be made there.
  static Result<NewFile> create(const std::string& path, bool overwrite);
  // The same for the last part of the path, in this folder (O_PATH is enough), whatever the path's other
  // parts mean by now.
  static Result<NewFile> create_in(UniqueFd folder, const std::string& path, bool overwrite);
  // Keeps all in memory, for take().
  static NewFile in_memory();

  NewFile(NewFile&& other) noexcept = default;
  NewFile& operator=(NewFile&& other) noexcept = default;
  ~NewFile() = default;  // without finish(): nothing is left

  // It is made of this file, or of this tape: it keeps from the group what one of its sources does. To be
  // called before anything is added. What is not there is no source. Errc::io.
  Result<void> made_of(const std::string& source) { return keep(kept_from_others(source)); }
  Result<void> made_of(const TapePaths& tape) { return keep(kept_from_others(tape)); }
  Result<void> made_of(int source) { return keep(kept_from_others(source)); }  // an open file
  Result<void> keep(mode_t from_others);

  // Errc::io.
  Result<void> add(std::string_view text);
  Result<void> add(ByteView bytes);
  // Errc::io; Errc::usage: somebody else has made a file of that name meanwhile, or begun to write a tape.
  Result<void> finish();

  [[nodiscard]] std::uint64_t size() const { return size_; }  // added so far
  [[nodiscard]] const std::string& name() const { return path_; }
  std::string take() { return std::move(buffer_); }

 private:
  enum class Kind { file, stdout_stream, memory };
  NewFile(Kind kind, std::string path) : kind_(kind), path_(std::move(path)) {}
  bool create_hidden();
  Result<void> flush();
  Result<void> failed(int error);
  Result<void> lock_existing(UniqueFd& existing) const;
  Result<void> keep_existing_mode();
  int publish();

  Kind kind_;
  std::string path_;
  UniqueFd folder_;
  std::string name_;  // there
  Leftover beside_;   // the path of the hidden name, if it has one
  UniqueFd fd_;
  bool overwrite_ = false;
  std::string buffer_;
  std::uint64_t size_ = 0;
  std::string trouble_;
};

}  // namespace porttape
