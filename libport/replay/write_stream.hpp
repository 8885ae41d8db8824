#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/base/error.hpp"
#include "libport/base/time.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What the tape expects the driver to write: the w file as one stream of bytes with a position, block
// boundaries and times. Looks ahead only when asked to, so it holds one piece of the tape. Zero-length blocks
// do not show.
//
// Refers to its source, which must outlive it. After an error of the source the stream looks ended and
// error() is set.
class WriteStream {
 public:
  explicit WriteStream(RecordSource& source) : source_(source) {}

  void rewind();

  // Finds the position again after someone else has used the source.
  void restore();

  // The bytes at the position, up to the end of the piece they are in; empty at the stream's end.
  [[nodiscard]] ByteView front();
  // When the block at the position was written; at the stream's end, when the last one was.
  [[nodiscard]] TapeTime front_at();
  // Whether front() reaches the end of its block.
  [[nodiscard]] bool front_ends_block();
  [[nodiscard]] bool at_end() { return front().empty(); }

  // Moves over `count` bytes of front().
  void consume(std::size_t count);

  // Up to `count` bytes from the position on, across blocks.
  [[nodiscard]] Bytes peek(std::size_t count);

  // Forward to `offset`, or to the stream's end.
  void skip_to(std::uint64_t offset);
  // Forward over whole blocks written before `at`.
  void skip_before(TapeTime at);

  [[nodiscard]] std::uint64_t position() const { return position_; }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }

 private:
  struct Piece {
    Bytes data;
    TapeTime at{};
    bool ends_block = false;
  };

  bool load();

  RecordSource& source_;
  std::deque<Piece> pieces_;
  std::size_t used_ = 0;  // of the first piece
  std::uint64_t position_ = 0;
  TapeTime last_at_{};
  bool ended_ = false;
  std::optional<Error> error_;
};

}  // namespace porttape
