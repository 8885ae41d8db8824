#pragma once

#include <cstdint>
#include <functional>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// Bytes of which only the first MiB are kept in memory, the others in a file without a name in the folder for
// temporary files. Owns its descriptor. Not thread-safe.
class SpilledBytes {
 public:
  // Errc::io.
  Result<void> add(ByteView bytes);
  [[nodiscard]] std::uint64_t size() const { return in_file_ + kept_.size(); }

  // Where all of them are in memory.
  [[nodiscard]] bool all_kept() const { return in_file_ == 0; }
  [[nodiscard]] ByteView kept() const { return kept_; }

  // All of them, piece by piece, up to the first error. Errc::io.
  Result<void> each_piece(const std::function<Result<void>(ByteView piece)>& take) const;
  void clear();

 private:
  Result<void> spill();

  Bytes kept_;  // behind those in the file
  UniqueFd fd_;
  std::uint64_t in_file_ = 0;
};

}  // namespace porttape
