#include "libport/replay/write_stream.hpp"

#include <algorithm>

namespace porttape {

void WriteStream::rewind() {
  pieces_.clear();
  used_ = 0;
  position_ = 0;
  last_at_ = {};
  ended_ = false;
  error_.reset();
  if (auto result = source_.rewind(); !result) error_ = result.error();
}

void WriteStream::restore() {
  const std::uint64_t position = position_;
  rewind();
  skip_to(position);
}

// Reads one more piece that holds bytes.
bool WriteStream::load() {
  while (!ended_ && !error_) {
    auto record = source_.next();
    if (!record) {
      error_ = record.error();
    } else if (!*record) {
      ended_ = true;
    } else if ((*record)->kind == RecordKind::write && !(*record)->data.empty()) {
      const Record& piece = **record;
      pieces_.push_back({Bytes(piece.data.begin(), piece.data.end()), piece.at, piece.last_piece()});
      return true;
    }
  }
  return false;
}

ByteView WriteStream::front() {
  if (pieces_.empty() && !load()) return {};
  return ByteView(pieces_.front().data).subspan(used_);
}

TapeTime WriteStream::front_at() { return front().empty() ? last_at_ : pieces_.front().at; }

bool WriteStream::front_ends_block() { return !front().empty() && pieces_.front().ends_block; }

void WriteStream::consume(std::size_t count) {
  if (count == 0) return;
  last_at_ = pieces_.front().at;
  used_ += count;
  position_ += count;
  if (used_ == pieces_.front().data.size()) {
    pieces_.pop_front();
    used_ = 0;
  }
}

Bytes WriteStream::peek(std::size_t count) {
  std::size_t held = 0;
  for (const Piece& piece : pieces_) held += piece.data.size();
  held -= used_;
  while (held < count && load()) held += pieces_.back().data.size();

  Bytes bytes;
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
  while (position_ < offset && !at_end()) {
    consume(static_cast<std::size_t>(std::min<std::uint64_t>(front().size(), offset - position_)));
  }
}

void WriteStream::skip_before(TapeTime at) {
  while (!at_end() && front_at() < at) consume(front().size());
}

}  // namespace porttape
