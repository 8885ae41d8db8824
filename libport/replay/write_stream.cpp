#include "libport/replay/write_stream.hpp"

#include <algorithm>

namespace porttape {

void WriteStream::rewind() {
  pieces_.clear();
  used_ = 0;
  position_ = 0;
  to_skip_ = 0;
  skip_before_.reset();
  last_at_ = {};
  ahead_ = {};
  ended_ = false;
  error_.reset();
  if (auto result = source_.rewind(); !result) error_ = result.error();
}

// Reads one more piece that holds bytes.
WriteStream::State WriteStream::load(Budget& budget) {
  while (!ended_ && !error_) {
    if (budget.spent()) return State::later;
    auto record = source_.next();
    if (!record) {
      error_ = record.error();
    } else if (!*record) {
      ended_ = true;
    } else {
      const Record& piece = **record;
      budget.spend(piece.data.size());
      if (piece.kind != RecordKind::write || piece.data.empty()) continue;
      pieces_.push_back(
          {Bytes(piece.data.begin(), piece.data.end()), piece.at, piece.piece_offset, piece.last_piece()});
      return State::bytes;
    }
  }
  return State::end;
}

WriteStream::State WriteStream::look() {
  while (true) {
    if (pieces_.empty()) {
      const State loaded = load(budget_);
      if (loaded == State::end) {
        position_ -= to_skip_;
        to_skip_ = 0;
        skip_before_.reset();
      }
      if (loaded != State::bytes) return loaded;
    }
    const std::size_t held = pieces_.front().data.size() - used_;
    if (to_skip_ > 0) {
      const auto part = static_cast<std::size_t>(std::min<std::uint64_t>(held, to_skip_));
      to_skip_ -= part;
      drop(part);
    } else if (skip_before_ && pieces_.front().at < *skip_before_) {
      position_ += held;
      drop(held);
    } else {
      skip_before_.reset();
      return State::bytes;
    }
  }
}

WriteStream::State WriteStream::look_ahead(const Expectation::Reach& reach) {
  const auto enough = [&] {
    return position_ >= ahead_.begin && position_ < ahead_.end() &&
           (ahead_.ends || ahead_.end() - position_ >= reach.bytes);
  };
  if (reach.bytes == 0 || enough()) return State::bytes;
  // Twice as much, so that it is not copied anew for each byte.
  std::size_t held = 0;
  for (const Piece& piece : pieces_) held += piece.data.size();
  State state = State::bytes;
  for (held -= used_; held < 2 * reach.bytes && state == State::bytes;) {
    state = load(budget_);
    if (state == State::bytes) held += pieces_.back().data.size();
  }
  copy_ahead(reach, state == State::end);
  return state == State::later && !enough() ? State::later : State::bytes;
}

// Up to the first pause.
void WriteStream::copy_ahead(const Expectation::Reach& reach, bool ended) {
  ahead_ = {.begin = position_, .ends = ended};
  TapeTime last = pieces_.front().at;
  std::size_t skip = used_;
  for (const Piece& piece : pieces_) {
    if (piece.at - last >= reach.pause) {
      ahead_.ends = true;
      return;
    }
    last = piece.at;
    ahead_.bytes.insert(ahead_.bytes.end(), piece.data.begin() + static_cast<std::ptrdiff_t>(skip),
                        piece.data.end());
    skip = 0;
  }
}

ByteView WriteStream::front() const {
  if (skips() || pieces_.empty()) return {};
  return ByteView(pieces_.front().data).subspan(used_);
}

void WriteStream::consume(std::size_t count) {
  if (count == 0) return;
  position_ += count;
  drop(count);
}

void WriteStream::drop(std::size_t count) {
  last_at_ = pieces_.front().at;
  used_ += count;
  if (used_ == pieces_.front().data.size()) {
    pieces_.pop_front();
    used_ = 0;
  }
}

Bytes WriteStream::peek(std::size_t count) {
  Bytes bytes;
  if (look() != State::bytes) return bytes;
  std::size_t held = 0;
  for (const Piece& piece : pieces_) held += piece.data.size();
  held -= used_;
  Budget ahead;  // its own: it is asked for once a mismatch
  while (held < count && load(ahead) == State::bytes) held += pieces_.back().data.size();

  std::size_t skip = used_;
  for (const Piece& piece : pieces_) {
    const ByteView rest = ByteView(piece.data).subspan(skip);
    const ByteView part = rest.first(std::min(rest.size(), count - bytes.size()));
    bytes.insert(bytes.end(), part.begin(), part.end());
    skip = 0;
  }
  return bytes;
}

void WriteStream::skip_to(std::uint64_t offset) {
  if (offset <= position_) return;
  to_skip_ += offset - position_;
  position_ = offset;
}

}  // namespace porttape
