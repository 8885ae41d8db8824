#include "libport/tape/block_file.hpp"

#include <cstring>
#include <utility>

#include "libport/tape/resync.hpp"

namespace porttape {

BlockFile::BlockFile(std::unique_ptr<ByteSource> source, Layout layout, Blocks blocks)
    : source_(std::move(source)),
      blocks_(blocks),
      decoder_(layout),
      buffer_(std::make_unique_for_overwrite<Byte[]>(kBufferSize)) {
  decoder_.set_end(0);
}

void BlockFile::seek(std::uint64_t offset, std::uint64_t stream_offset) {
  decoder_ = BlockDecoder(decoder_.layout(), offset, stream_offset);
  decoder_.set_end(known_size_ = 0);
  begin_ = end_ = 0;
  torn_bytes_ = 0;
  ended_ = false;
  error_.reset();
}

// An unfinished block may have been cut off again: nothing of it is kept.
void BlockFile::read_on() {
  if (!ended_ || error_ || decoder_.inside_block()) return;
  ended_ = false;
  torn_bytes_ = 0;
  begin_ = end_ = 0;
  decoder_.set_end(known_size_ = 0);
}

std::optional<std::string> BlockFile::torn_tail() const {
  if (torn_bytes_ == 0) return std::nullopt;
  return name() + ": torn tail at offset " + std::to_string(decoder_.offset()) + ": the last " +
         std::to_string(torn_bytes_) + " bytes are an unfinished block and do not count";
}

// Everything but the next block that lies in the buffer ready to be given.
BlockFile::Step BlockFile::next_slow(BlockDecoder::Step step) {
  for (;;) {
    std::optional<Step> done;
    switch (step) {
      case BlockDecoder::Step::piece:
        begin_ += decoder_.consumed();
        return Step::piece;
      case BlockDecoder::Step::damage:
        return fail_damaged(decoder_.damage());
      case BlockDecoder::Step::need_bytes:
        done = refill();
        break;
      case BlockDecoder::Step::past_end:
        done = on_past_end();
        break;
    }
    if (done) return *done;
    const bool too_large = step == BlockDecoder::Step::need_bytes && decoder_.needed() > kBufferSize;
    step = decoder_.next(ByteView(buffer_.get() + begin_, end_ - begin_),
                         blocks_ == Blocks::whole && !too_large);
  }
}

// Moves the unread bytes to the front and reads on behind them.
std::optional<BlockFile::Step> BlockFile::refill() {
  const std::size_t unread = end_ - begin_;
  std::memmove(buffer_.get(), buffer_.get() + begin_, unread);
  begin_ = 0;
  end_ = unread;
  if (unread == kBufferSize) return std::nullopt;  // a block larger than the buffer: it is given in pieces
  const auto got =
      source_->read_at(decoder_.offset() + unread, {buffer_.get() + unread, kBufferSize - unread});
  if (!got) return fail(got.error());
  end_ += *got;
  if (*got > 0) return std::nullopt;
  if (decoder_.inside_block() || unread >= header_size(decoder_.layout())) {
    return fail(make_error(Errc::io, name() + " became shorter while it was read"));
  }
  return finish(unread);
}

// The block reaches past the end as far as known: has the file grown, is the tail torn, or is the length
// wrong?
std::optional<BlockFile::Step> BlockFile::on_past_end() {
  const auto size = source_->size();
  if (!size) return fail(size.error());
  if (*size > known_size_) {
    decoder_.set_end(known_size_ = *size);
    return std::nullopt;
  }
  const std::uint64_t payload = decoder_.offset() + header_size(decoder_.layout());
  const auto chain =
      find_block_chain(*source_, decoder_.layout(), payload, known_size_, header_time_us(decoder_.header()));
  if (!chain) return fail(chain.error());
  if (!*chain) return finish(known_size_ > decoder_.offset() ? known_size_ - decoder_.offset() : 0);
  return fail_damaged("a length of " + std::to_string(decoder_.header().length) +
                      " bytes runs past the end of the file, but blocks follow from offset " +
                      std::to_string(**chain));
}

BlockFile::Step BlockFile::finish(std::uint64_t torn_bytes) {
  ended_ = true;
  torn_bytes_ = torn_bytes;
  return Step::end;
}

BlockFile::Step BlockFile::fail(Error error) {
  ended_ = true;
  error_ = std::move(error);
  return Step::failed;
}

BlockFile::Step BlockFile::fail_damaged(const std::string& reason) {
  return fail(make_error(Errc::damaged_tape, name() + " is damaged at offset " +
                                                 std::to_string(decoder_.offset()) + ": " + reason));
}

}  // namespace porttape
