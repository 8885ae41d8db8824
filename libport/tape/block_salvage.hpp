#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "libport/tape/block.hpp"
#include "libport/tape/source_window.hpp"
#include "libport/tape/stored_bytes.hpp"

namespace porttape {

// A block of a damaged file; its data stays there.
struct SalvagedBlock {
  TapeTime at{};
  std::uint64_t offset = 0;  // of its header
  std::uint64_t data_offset = 0;
  std::uint32_t length = 0;

  [[nodiscard]] std::uint64_t end() const { return data_offset + length; }
};

struct LostBytes {
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;  // of the file; 0: a time or a length was wrong, and the block stays
  TapeTime from{};          // of the block before
  std::string why;
};

// Finds the sound blocks of an r or w file, before damage and behind it, in constant memory. A block counts
// as sound once those behind it are; where they are not, it is looked for where blocks go on, in the data of
// the last ones too, since a length may be wrong. A time that is out of order becomes that of the block
// beside it, a length that is too small by less than a block's header what it was. A long hole of the file is
// lost, and so is a block with one in it. Owns the source.
//
// Searches are bounded by prices that are fixed, not by a clock: whatever the file holds, they take less than
// a microsecond for each byte that is on the disk. What is left when that is spent counts as lost, and says
// so.
class BlockSalvage {
 public:
  BlockSalvage(std::unique_ptr<ByteSource> source, Layout layout, std::uint64_t size);

  // What was lost, then the block that follows it. Neither: the end.
  struct Step {
    std::optional<LostBytes> lost;
    std::optional<SalvagedBlock> block;
  };
  Result<Step> next();

  // Some of the bytes from `offset` on, at most `most`; nothing where the file ends. Valid until the next
  // call.
  Result<ByteView> data(std::uint64_t offset, std::size_t most) { return copy_.view(offset, most); }

  [[nodiscard]] const std::string& name() const { return source_->name(); }

  // Whether blocks follow one another from somewhere in the first 64 MiB on.
  static Result<bool> holds_blocks(ByteSource& source, Layout layout, std::uint64_t size);

 private:
  struct Chain {
    bool strong = false;    // that it is by chance is out of the question
    std::uint64_t end = 0;  // how far it goes
  };

  Result<void> advance();
  Result<std::optional<BlockHeader>> header_at(std::uint64_t offset, SourceWindow& window);
  [[nodiscard]] bool fits(const BlockHeader& header, std::uint64_t offset);
  void pay(std::int64_t price) { work_left_ -= price; }
  [[nodiscard]] bool spent() const { return work_left_ < 0; }
  void take(const BlockHeader& header, std::int64_t us);
  Result<bool> mend_time(const BlockHeader& header);
  Result<void> resync(const std::string& why);
  Result<bool> resume_inside(const std::string& why);
  Result<bool> resume_behind(const std::string& why, std::int64_t not_before_us);
  void resume(std::uint64_t at, std::uint64_t lost_from, const std::string& why);
  void emit_pending(std::size_t count);
  void lose(std::uint64_t from, std::uint64_t bytes, std::string why);
  [[nodiscard]] std::int64_t last_us() const;
  [[nodiscard]] bool is_boundary(std::uint64_t offset) const;

  Result<Chain> follow(std::uint64_t offset, std::int64_t not_before_us, std::uint64_t beyond,
                       std::int64_t most);
  Result<std::optional<std::uint64_t>> find(std::uint64_t from, std::uint64_t to, std::int64_t not_before_us,
                                            std::uint64_t beyond);

  std::unique_ptr<ByteSource> source_;
  Layout layout_;
  std::size_t head_;
  std::uint64_t size_;
  SourceWindow lead_;
  SourceWindow search_;
  SourceWindow chain_;
  SourceWindow copy_;
  std::uint64_t scan_ = 0;             // of the next header
  std::deque<SalvagedBlock> pending_;  // in front of it, not sure yet
  std::int64_t given_us_ = 0;          // of the last block that is sure
  std::optional<LostBytes> lost_;      // in front of the next block
  std::deque<Step> ready_;
  bool mending_ = false;
  bool over_ = false;
  StoredBytes stored_{*source_};
  std::int64_t work_left_;  // nanoseconds, by the prices
};

}  // namespace porttape
