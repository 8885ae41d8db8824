#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What one tape has, in memory: the bytes of both directions, each in a row, and how they came.
struct SessionTape {
  struct Block {
    Direction direction = Direction::write;
    TapeTime at{};
    std::size_t begin = 0;  // in `writes` or `reads`
    std::size_t size = 0;
    friend bool operator==(const Block&, const Block&) = default;
  };

  std::string name;
  Bytes writes;
  Bytes reads;
  std::vector<Block> blocks;  // in the tape's order, none empty
  bool gaps = false;          // bytes are missing

  [[nodiscard]] ByteView bytes_of(const Block& block) const {
    return ByteView(block.direction == Direction::write ? writes : reads).subspan(block.begin, block.size);
  }
};

// Reads a tape to its end. Errc::usage: it has more than `most` bytes in one direction.
Result<SessionTape> read_session(RecordSource& source, std::string name, std::size_t most);

// The writes of a session as the matcher reads them: one record a block. Refers to the session.
class SessionWrites final : public RecordSource {
 public:
  explicit SessionWrites(const SessionTape& session) : session_(session) {}

  Result<std::optional<Record>> next() override;
  Result<void> rewind() override;

 private:
  const SessionTape& session_;
  std::size_t block_ = 0;
};

}  // namespace porttape
