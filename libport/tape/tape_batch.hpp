#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_sink.hpp"

namespace porttape {

// Blocks and event lines that wait to be written in one go: few calls, where each may take long. Plain data;
// times are the stamps they got.
struct TapeBatch {
  struct Block {
    std::int64_t us = 0;
    std::size_t header = 0;  // bytes before the payload
    std::size_t end = 0;     // in `bytes`
  };
  // What waits for one of the r and w files.
  struct Blocks {
    Bytes bytes;  // headers and payloads
    std::vector<Block> blocks;
    WholeAppender::Kept kept;  // once written

    void add(std::int64_t us, ByteView block_header, ByteView payload);
    void write(WholeAppender& file);
    [[nodiscard]] ByteView payload(std::size_t block) const;
  };
  struct Line {
    std::int64_t us = 0;
    std::string text;
  };

  [[nodiscard]] Blocks& of(Direction direction) { return direction == Direction::read ? read : write; }

  Blocks read;
  Blocks write;
  std::vector<Line> lines;
};

// Runs two pieces of work, at the same time if it can.
using RunBoth = std::function<void(const std::function<void()>& one, const std::function<void()>& other)>;

}  // namespace porttape
