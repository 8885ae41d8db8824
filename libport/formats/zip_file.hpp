#pragma once

#include <memory>
#include <optional>
#include <string>

#include "libport/formats/evidence.hpp"
#include "libport/tape/new_file.hpp"

namespace porttape {

// Reads a zip from front to back. Constant memory. Not thread-safe; the evidence is to live as long.
class ZipReader {
 public:
  explicit ZipReader(Evidence& from);
  ZipReader(const ZipReader&) = delete;
  ZipReader& operator=(const ZipReader&) = delete;
  ~ZipReader();

  // The next file's name; nothing: the end. Errc::damaged_tape.
  Result<std::optional<std::string>> next();
  // Of that file; empty: its end. Valid until the next call.
  Result<ByteView> read();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Writes a zip, deflated. Not thread-safe; the file is to live as long.
class ZipWriter {
 public:
  explicit ZipWriter(NewFile& to);
  ZipWriter(const ZipWriter&) = delete;
  ZipWriter& operator=(const ZipWriter&) = delete;
  ~ZipWriter();

  // Errc::io.
  Result<void> add(const std::string& name, ByteView bytes);
  Result<void> finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace porttape
