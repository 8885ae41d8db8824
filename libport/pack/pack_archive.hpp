#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/pack/pack_manifest.hpp"
#include "libport/tape/byte_source.hpp"

namespace porttape {

enum class PackFormat : std::uint8_t { gzip, zstd };

// Writes a pack's container: a compressed tar of plain files in one folder, which tar(1) opens. Nothing of
// the machine is in it: no owner, no group.
class PackWriter {
 public:
  using Put = std::function<Result<void>(ByteView)>;

  // Errc::io, and those of `put`, which gets the archive.
  static Result<PackWriter> begin(Put put, PackFormat format, const std::string& folder);
  PackWriter(PackWriter&&) noexcept;
  PackWriter& operator=(PackWriter&&) noexcept;
  ~PackWriter();

  // Then all its bytes by write().
  Result<void> begin_file(const std::string& name, std::uint64_t size);
  Result<void> write(ByteView bytes);
  Result<void> finish();

 private:
  struct Impl;
  explicit PackWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Where the files of a pack go.
class PackSink {
 public:
  virtual ~PackSink() = default;
  // A plain name, none of those before.
  virtual Result<void> begin_file(const std::string& name, std::uint64_t size) = 0;
  virtual Result<void> write(ByteView bytes) = 0;
  virtual Result<void> end_file() = 0;
};

struct PackLimits {
  // Of all files. Without a value the limit is kUsualFactor times the size of the pack, and at least
  // kUsualBytes, so that a small file from a stranger cannot fill the disk.
  std::optional<std::uint64_t> bytes = {};
  static constexpr std::uint64_t kUsualFactor = 100;
  static constexpr std::uint64_t kUsualBytes = 100'000'000;
  std::size_t files = 10'000;
};

// Reads a pack: its manifest first, then the files that this names, each with the size and the digest that it
// says, and nothing else. Whatever the archive holds, the sink gets plain names once, and no more bytes than
// the manifest tells of; memory is bounded. Errc::not_a_tape: it is no pack; Errc::usage: it is beyond the
// limits; Errc::io: what is wrong with it, or the sink's.
Result<PackManifest> read_pack(ByteSource& source, PackSink& sink, const PackLimits& limits);

}  // namespace porttape
