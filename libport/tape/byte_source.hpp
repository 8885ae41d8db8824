#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// Where the bytes of one file of a tape come from. Not thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  // Fills `into` with the bytes from `offset` on; fewer only where the source ends. Errc::io.
  virtual Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) = 0;

  // Bytes there are now; a tape that is being written grows.
  virtual Result<std::uint64_t> size() = 0;

  // The bytes from `begin` up to `end`, of which each takes space on the disk.
  struct Stretch {
    std::uint64_t begin = 0;
    std::uint64_t end = 0;
  };
  // The first of those at `offset` or behind it. What lies between two of them is a hole: nobody wrote it,
  // and it reads as zeros. Nothing but a hole: empty, at the source's end. A source that cannot tell has no
  // holes.
  virtual Stretch stored(std::uint64_t offset);

  // What a person calls it: the path.
  [[nodiscard]] virtual const std::string& name() const = 0;
};

// A regular file, read with pread. Owns its descriptor.
class FileSource final : public ByteSource {
 public:
  // Errc::usage: not there, not readable, or not a regular file (a FIFO or a device is not even opened).
  static Result<std::unique_ptr<FileSource>> open(const std::filesystem::path& path);
  // The same for a name in an open folder (O_PATH is enough). A link of that name is not followed, and is
  // Errc::usage. Messages call the file `shown`.
  static Result<std::unique_ptr<FileSource>> open_in(int folder, const std::string& name, std::string shown);
  // Another source of the same open file, whatever its name means by now. Errc::io.
  [[nodiscard]] Result<std::unique_ptr<FileSource>> duplicate() const;

  [[nodiscard]] int fd() const { return fd_.get(); }
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override;
  Result<std::uint64_t> size() override;
  Stretch stored(std::uint64_t offset) override;
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  static Result<std::unique_ptr<FileSource>> open_at(int folder, const char* path, bool follows,
                                                     std::string shown);
  FileSource(UniqueFd fd, std::string name) : fd_(std::move(fd)), name_(std::move(name)) {}

  UniqueFd fd_;
  std::string name_;
};

// Bytes in memory. Owns them.
class MemorySource final : public ByteSource {
 public:
  MemorySource(std::string name, Bytes bytes) : name_(std::move(name)), bytes_(std::move(bytes)) {}

  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override;
  Result<std::uint64_t> size() override { return bytes_.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::string name_;
  Bytes bytes_;
};

}  // namespace porttape
