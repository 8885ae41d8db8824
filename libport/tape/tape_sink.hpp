#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <sys/types.h>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// Where the bytes of one file of a tape go. Errors are errno values, 0 is success. Not thread-safe.
class TapeSink {
 public:
  struct Appended {
    std::size_t bytes = 0;  // that went in, also when there is an error
    int error = 0;
  };

  virtual ~TapeSink() = default;

  // Puts head and body behind what is there, as one operation where the system can.
  virtual Appended append(ByteView head, ByteView body) = 0;
  // Cuts to `size` bytes, never more than there are.
  virtual int truncate(std::uint64_t size) = 0;
  // Brings what was appended to the disk; ENOENT where the file has lost its name. The function may be called
  // from any thread at any time, also when the sink is closed or gone.
  using Sync = std::function<int()>;
  [[nodiscard]] virtual Sync syncer() = 0;
  virtual int close() = 0;
};

// A regular file, opened with O_APPEND. Owns its descriptors: one to write, a second one to sync.
class FileSink final : public TapeSink {
 public:
  // Makes a new file of mode 0640, less what is kept from others, never following a symlink, and locks it
  // until it is closed. The errno otherwise (EEXIST if anything is there, or somebody else has locked the new
  // file first).
  static std::unique_ptr<FileSink> create(int folder, const std::filesystem::path& name, int& error,
                                          mode_t kept_from_others = 0);
  // The same without a name: link() gives it one, and without that it goes away with its last descriptor. Not
  // locked. EOPNOTSUPP where the file system has no such files.
  static std::unique_ptr<FileSink> create_unnamed(int folder, int& error, mode_t kept_from_others = 0);
  // 0 or the errno; EEXIST if anything is there.
  [[nodiscard]] int link(int folder, const std::filesystem::path& name) const;

  Appended append(ByteView head, ByteView body) override;
  int truncate(std::uint64_t size) override;
  Sync syncer() override;
  int close() override;

 private:
  FileSink(UniqueFd fd, UniqueFd sync_fd)
      : fd_(std::move(fd)), sync_fd_(std::make_shared<UniqueFd>(std::move(sync_fd))) {}

  UniqueFd fd_;
  std::shared_ptr<UniqueFd> sync_fd_;
};

// Appends to a sink wholly or not at all: what went in of a failed append is taken back before anything else
// is written. Owns the sink.
class WholeAppender {
 public:
  explicit WholeAppender(std::unique_ptr<TapeSink> sink) : sink_(std::move(sink)) {}

  // 0, or the errno: nothing of it counts then.
  int append(ByteView head, ByteView body);
  // Several parts, `ends` says where each ends in `parts`: as many whole ones as fit. How many those are.
  struct Kept {
    std::size_t parts = 0;
    int error = 0;
  };
  Kept append_parts(ByteView parts, std::span<const std::size_t> ends);
  // As a last step: takes back what is still to be taken back.
  int repair();

  TapeSink& sink() { return *sink_; }

 private:
  std::unique_ptr<TapeSink> sink_;
  std::uint64_t size_ = 0;  // bytes that count
  bool torn_ = false;       // there are bytes behind them
};

}  // namespace porttape
