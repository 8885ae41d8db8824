#include "libport/tape/tape_batch.hpp"

namespace porttape {

void TapeBatch::Blocks::add(std::int64_t us, ByteView block_header, ByteView payload) {
  bytes.insert(bytes.end(), block_header.begin(), block_header.end());
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  blocks.push_back({us, block_header.size(), bytes.size()});
}

void TapeBatch::Blocks::write(WholeAppender& file) {
  if (blocks.empty()) return;
  std::vector<std::size_t> ends;
  ends.reserve(blocks.size());
  for (const Block& block : blocks) ends.push_back(block.end);
  kept = file.append_parts(bytes, ends);
}

ByteView TapeBatch::Blocks::payload(std::size_t block) const {
  const std::size_t begin = (block == 0 ? 0 : blocks[block - 1].end) + blocks[block].header;
  return ByteView(bytes).subspan(begin, blocks[block].end - begin);
}

}  // namespace porttape
