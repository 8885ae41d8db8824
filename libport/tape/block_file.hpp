#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "libport/tape/block.hpp"
#include "libport/tape/byte_source.hpp"

namespace porttape {

// Reads the blocks of one r or w file in order, through one buffer of kBufferSize bytes. Owns the source.
//
// Drive it by next() until it gives `end` or `failed`, which then come again at every further call; rewind()
// starts again. piece() is valid until the next call. Not thread-safe. The file may grow meanwhile: `end` is
// where it ended when reached.
class BlockFile {
 public:
  static constexpr std::size_t kBufferSize = std::size_t{256} * 1024;

  enum class Step : std::uint8_t { piece, end, failed };
  enum class Blocks : std::uint8_t {
    whole,     // one piece each, except a block that does not fit the buffer
    in_pieces  // cut wherever the buffer ends: no copying
  };

  BlockFile(std::unique_ptr<ByteSource> source, Layout layout, Blocks blocks);

  Step next() {
    if (ended_) [[unlikely]]
      return error_ ? Step::failed : Step::end;
    const auto step =
        decoder_.next(ByteView(buffer_.get() + begin_, end_ - begin_), blocks_ == Blocks::whole);
    if (step != BlockDecoder::Step::piece) [[unlikely]]
      return next_slow(step);
    begin_ += decoder_.consumed();
    return Step::piece;
  }

  // Starts again at the first block, also after an error.
  void rewind() { seek(0, 0); }
  // Starts at the block whose header is at `offset`, with so many payload bytes before it, as a piece has
  // told of it.
  void seek(std::uint64_t offset, std::uint64_t stream_offset);
  // After `end`: goes on there, for a file that may have grown since.
  void read_on();

  [[nodiscard]] const BlockPiece& piece() const { return decoder_.piece(); }
  [[nodiscard]] const Error& error() const {
    return *error_;
  }  // after `failed`: Errc::damaged_tape or Errc::io
  [[nodiscard]] std::uint64_t error_offset() const { return decoder_.offset(); }
  // After `end`: bytes of an unfinished block at the end, 0 if the last block is whole.
  [[nodiscard]] std::uint64_t torn_bytes() const { return torn_bytes_; }
  // The torn tail as a note for a person, nothing if there is none.
  [[nodiscard]] std::optional<std::string> torn_tail() const;
  [[nodiscard]] const std::string& name() const { return source_->name(); }
  [[nodiscard]] Layout layout() const { return decoder_.layout(); }

 private:
  Step next_slow(BlockDecoder::Step step);
  std::optional<Step> refill();
  std::optional<Step> on_past_end();
  Step finish(std::uint64_t torn_bytes);
  Step fail(Error error);
  Step fail_damaged(const std::string& reason);

  std::unique_ptr<ByteSource> source_;
  Blocks blocks_;
  BlockDecoder decoder_;
  std::unique_ptr<Byte[]> buffer_;
  std::size_t begin_ = 0;  // the unread bytes are [begin_, end_) of the buffer
  std::size_t end_ = 0;
  std::uint64_t known_size_ = 0;
  std::uint64_t torn_bytes_ = 0;
  bool ended_ = false;
  std::optional<Error> error_;
};

}  // namespace porttape
