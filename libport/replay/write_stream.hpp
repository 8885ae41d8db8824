#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/base/error.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What the tape expects the driver to write: the w file as one stream of bytes with a position, block
// boundaries and times. Looks ahead only when asked to, so it holds one piece of the tape. Zero-length blocks
// do not show.
//
// Drive it by look(), which reads as far as the budget allows; front() and its like are about what look() has
// found. Refers to its source and its budget, which must outlive it. After an error of the source the stream
// looks ended and error() is set.
class WriteStream {
 public:
  enum class State : std::uint8_t {
    bytes,  // front() has some
    end,
    later  // not known yet: the budget is spent; ask again when it is refilled
  };

  WriteStream(RecordSource& source, Budget& budget) : source_(source), budget_(budget) {}

  void rewind();

  // What comes at the position.
  [[nodiscard]] State look();

  // After `bytes`: the bytes at the position, up to the end of the piece they are in.
  [[nodiscard]] ByteView front() const;
  // When the block at the position was written; where look() gave no bytes, when the last one was.
  [[nodiscard]] TapeTime front_at() const {
    return skips() || pieces_.empty() ? last_at_ : pieces_.front().at;
  }
  // Whether front() reaches the end of its block.
  [[nodiscard]] bool front_ends_block() const { return !front().empty() && pieces_.front().ends_block; }

  // After `bytes`: reads on until what is at hand behind the position is as much as `reach` says, or ends
  // where it says; `bytes`, or `later`. stretch() then has it.
  [[nodiscard]] State look_ahead(const Expectation::Reach& reach);

  // After `bytes`: front() with its place.
  [[nodiscard]] Expectation::Stretch stretch() const {
    return {front(),
            ByteView(pieces_.front().data).first(used_),
            position_,
            front_in_block(),
            front_ends_block(),
            front_at(),
            ahead_.behind(position_ + front().size()),
            ahead_.ends};
  }

  // Moves over `count` bytes of front().
  void consume(std::size_t count);

  // Up to `count` bytes from the position on, across blocks; fewer where many empty ones are between.
  [[nodiscard]] Bytes peek(std::size_t count);

  // Forward to `offset`, or to the stream's end: position() says so at once, look() does the reading.
  void skip_to(std::uint64_t offset);
  // Forward over whole blocks written before `at`; position() grows as look() gets there.
  void skip_before(TapeTime at) { skip_before_ = at; }
  // Whether bytes written at `at` or later may have been passed.
  [[nodiscard]] bool passed(TapeTime at) const { return to_skip_ > 0 || (position_ > 0 && last_at_ >= at); }

  [[nodiscard]] std::uint64_t position() const { return position_; }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }

 private:
  struct Piece {
    Bytes data;
    TapeTime at{};
    std::uint32_t in_block = 0;  // where it begins
    bool ends_block = false;
  };

  // A copy in one of what the pieces hold from the stream's offset `begin` on.
  struct Ahead {
    Bytes bytes{};
    std::uint64_t begin = 0;
    bool ends = false;  // at the stream's end, or at a pause

    [[nodiscard]] std::uint64_t end() const { return begin + bytes.size(); }
    [[nodiscard]] ByteView behind(std::uint64_t offset) const {
      if (offset < begin || offset >= end()) return {};
      return ByteView(bytes).subspan(static_cast<std::size_t>(offset - begin));
    }
  };

  State load(Budget& budget);
  void copy_ahead(const Expectation::Reach& reach, bool ended);
  void drop(std::size_t count);
  [[nodiscard]] std::uint32_t front_in_block() const {
    return pieces_.front().in_block + static_cast<std::uint32_t>(used_);
  }
  [[nodiscard]] bool skips() const { return to_skip_ > 0 || skip_before_.has_value(); }

  RecordSource& source_;
  Budget& budget_;
  std::deque<Piece> pieces_;
  std::size_t used_ = 0;  // of the first piece
  std::uint64_t position_ = 0;
  std::uint64_t to_skip_ = 0;  // bytes before the position that are still to be read
  std::optional<TapeTime> skip_before_;
  TapeTime last_at_{};
  Ahead ahead_;
  bool ended_ = false;
  std::optional<Error> error_;
};

}  // namespace porttape
