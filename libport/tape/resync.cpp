#include "libport/tape/resync.hpp"

#include <algorithm>
#include <array>

namespace porttape {
namespace {

constexpr std::uint64_t kSearchBytes = 1U << 20U;  // the chain must start this near
constexpr int kEnoughBlocks = 8;                   // a chain this long need not reach the end
constexpr int kMaxHeaderReads = 100'000;           // all candidates together
constexpr std::int64_t kMaxStepUs = std::int64_t{24} * 3600 * 1'000'000;

class ChainFinder {
 public:
  ChainFinder(ByteSource& source, Layout layout, std::uint64_t file_size)
      : source_(source), layout_(layout), head_(header_size(layout)), size_(file_size) {}

  // Tries every offset from `from` on.
  Result<std::optional<std::uint64_t>> find(std::uint64_t from, std::int64_t not_before_us) {
    if (size_ < from + head_) return std::optional<std::uint64_t>{};
    const std::uint64_t last = std::min(size_ - head_, from + kSearchBytes);
    std::array<Byte, 4096> window{};
    while (from <= last) {
      const auto got = source_.read_at(from, window);
      if (!got) return got.error();
      if (*got < head_) break;
      for (std::size_t i = 0; i + head_ <= *got && from + i <= last; ++i) {
        const BlockHeader header = parse_header(layout_, window.data() + i);
        if (!plausible(header, from + i, not_before_us)) continue;
        const auto chain = is_chain(header, from + i);
        if (!chain) return chain.error();
        if (*chain) return std::optional(from + i);
      }
      from += *got - head_ + 1;
    }
    return std::optional<std::uint64_t>{};
  }

 private:
  // A block with data, inside the file, no earlier than `not_before_us` and at most a day later.
  [[nodiscard]] bool plausible(const BlockHeader& header, std::uint64_t offset,
                               std::int64_t not_before_us) const {
    return check_header(header, not_before_us) == HeaderFault::none && header.length > 0 &&
           header.length <= size_ - offset - head_ && header_time_us(header) - not_before_us <= kMaxStepUs;
  }

  // Whether the block at `offset` and those behind it, each later than the one before, reach the exact end or
  // are enough.
  Result<bool> is_chain(BlockHeader header, std::uint64_t offset) {
    std::array<Byte, kMaxHeaderSize> bytes{};
    for (int blocks = 1;; ++blocks) {
      offset += head_ + header.length;
      if (offset == size_ || blocks == kEnoughBlocks) return true;
      if (size_ - offset < head_ || ++header_reads_ > kMaxHeaderReads) return false;
      const auto got = source_.read_at(offset, std::span(bytes).first(head_));
      if (!got) return got.error();
      if (*got < head_) return false;
      const std::int64_t before = header_time_us(header);
      header = parse_header(layout_, bytes.data());
      if (!plausible(header, offset, before + 1)) return false;
    }
  }

  ByteSource& source_;
  Layout layout_;
  std::size_t head_;
  std::uint64_t size_;
  int header_reads_ = 0;
};

}  // namespace

Result<std::optional<std::uint64_t>> find_block_chain(ByteSource& source, Layout layout, std::uint64_t from,
                                                      std::uint64_t file_size, std::int64_t not_before_us) {
  return ChainFinder(source, layout, file_size).find(from, not_before_us);
}

}  // namespace porttape
