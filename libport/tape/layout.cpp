#include "libport/tape/layout.hpp"

#include <algorithm>
#include <array>
#include <compare>
#include <limits>

#include "libport/tape/resync.hpp"

namespace porttape {
namespace {

constexpr std::size_t kWindow = std::size_t{64} * 1024;
// What the only block of a file, itself unfinished, may claim and still be taken for a block.
constexpr std::uint64_t kMaxTornLength = 64U << 20U;
constexpr std::uint64_t kMaxTornSeconds = (1ULL << 31U) - 1;

// How a file's beginning reads in one layout; the smaller, the better.
struct Reading {
  enum class End : std::uint8_t { clean, goes_on, torn, damaged, no_tape };

  End end = End::clean;
  std::uint64_t blocks = 0;   // with data: an empty one is no evidence, zeros read as such in both layouts
  std::uint64_t claimed = 0;  // length of an unfinished block
  bool unsure = false;  // only the beginning of a header is there, too little to tell it from anything else

  [[nodiscard]] bool is_tape(const Reading& other) const {
    return end != End::no_tape && (!unsure || other.blocks > 0);
  }
};

// The beginning of a first header, with zeros for what is missing.
BlockHeader parse_beginning(Layout layout, ByteView bytes) {
  std::array<Byte, kMaxHeaderSize> header{};
  std::copy(bytes.begin(), bytes.end(), header.begin());
  return parse_header(layout, header.data());
}

// Whether so little of a header tells nothing: less than its seconds, or seconds that text would have too.
bool is_unsure(Layout layout, ByteView bytes) {
  return layout == Layout::big_endian ? bytes[0] != 0 && bytes.size() <= 8 : bytes.size() < 8;
}

class Sniffer {
 public:
  Sniffer(ByteSource& source, Layout layout, ByteView prefix, std::uint64_t size)
      : source_(source), layout_(layout), head_(header_size(layout)), prefix_(prefix), size_(size) {}

  Result<Reading> read() {
    std::int64_t time = 0;
    while (offset_ + head_ <= prefix_.size()) {
      const BlockHeader header = parse_header(layout_, prefix_.data() + offset_);
      if (check_header(header, time) != HeaderFault::none) {
        return end(reading_.blocks > 0 ? Reading::End::damaged : Reading::End::no_tape);
      }
      if (header.length > size_ - offset_ - head_) return past_end(header);
      time = header_time_us(header);
      offset_ += head_ + header.length;
      if (header.length > 0) ++reading_.blocks;
    }
    if (offset_ == size_) return end(Reading::End::clean);
    if (prefix_.size() < size_) return end(Reading::End::goes_on);
    if (reading_.blocks > 0) return end(Reading::End::torn);
    const ByteView rest = prefix_.subspan(offset_);
    reading_.unsure = is_unsure(layout_, rest);
    const HeaderFault fault = check_header(parse_beginning(layout_, rest), 0);
    return end(fault == HeaderFault::none ? Reading::End::torn : Reading::End::no_tape);
  }

 private:
  Reading end(Reading::End how) {
    reading_.end = how;
    return reading_;
  }

  // An unfinished block. Where it is the first, its header alone must carry the weight.
  Result<Reading> past_end(const BlockHeader& header) {
    reading_.claimed = header.length;
    if (reading_.blocks > 0) return end(Reading::End::torn);
    if (header.length <= kMaxTornLength && header.seconds <= kMaxTornSeconds) return end(Reading::End::torn);
    const auto chain = find_block_chain(source_, layout_, offset_ + head_, size_, header_time_us(header));
    if (!chain) return chain.error();
    return end(*chain ? Reading::End::damaged : Reading::End::no_tape);
  }

  ByteSource& source_;
  Layout layout_;
  std::size_t head_;
  ByteView prefix_;
  std::uint64_t size_;
  std::uint64_t offset_ = 0;
  Reading reading_;
};

struct Readings {
  Reading big_endian;
  Reading native64;
};

Result<Readings> sniff(ByteSource* source) {
  if (source == nullptr) return Readings{};
  const auto size = source->size();
  if (!size) return size.error();
  Bytes prefix(static_cast<std::size_t>(std::min<std::uint64_t>(*size, kWindow)));
  const auto got = source->read_at(0, prefix);
  if (!got) return got.error();
  const std::uint64_t now = *got < prefix.size() ? *got : *size;  // it may have shrunk in between
  prefix.resize(*got);
  const auto big_endian = Sniffer(*source, Layout::big_endian, prefix, now).read();
  if (!big_endian) return big_endian.error();
  const auto native64 = Sniffer(*source, Layout::native64, prefix, now).read();
  if (!native64) return native64.error();
  return Readings{*big_endian, *native64};
}

// How well a pair reads in one layout.
struct Rank {
  bool is_tape = false;
  std::uint64_t blocks = 0;
  bool sound = false;
  int neatness = 0;
  std::uint64_t claimed = 0;  // less is better

  Rank(const Reading& r, const Reading& w)
      : is_tape(r.is_tape(w) && w.is_tape(r)),
        blocks(r.blocks + w.blocks),
        sound(r.end < Reading::End::damaged && w.end < Reading::End::damaged),
        neatness(-static_cast<int>(r.end) - static_cast<int>(w.end)),
        claimed(std::numeric_limits<std::uint64_t>::max() - std::max(r.claimed, w.claimed)) {}

  auto operator<=>(const Rank&) const = default;
};

// The file is in the one layout, and in the other its first block would be unfinished.
bool is_only(const Reading& one, const Reading& other) {
  return one.end <= Reading::End::goes_on && one.blocks > 0 && other.blocks == 0;
}

Error different_layouts(const ByteSource& read, const ByteSource& write) {
  return make_error(Errc::not_a_tape, read.name() + " and " + write.name() +
                                          " are in different layouts: they are not the files of one tape");
}

Error not_a_tape(const ByteSource& source) {
  return make_error(Errc::not_a_tape,
                    source.name() + " is not a file of a tape: it does not begin with a block");
}

}  // namespace

Result<Layout> detect_layout(ByteSource* read, ByteSource* write) {
  const auto r = sniff(read);
  if (!r) return r.error();
  const auto w = sniff(write);
  if (!w) return w.error();
  if ((is_only(r->native64, r->big_endian) && is_only(w->big_endian, w->native64)) ||
      (is_only(r->big_endian, r->native64) && is_only(w->native64, w->big_endian))) {
    return different_layouts(*read, *write);
  }
  const Rank big_endian(r->big_endian, w->big_endian);
  const Rank native64(r->native64, w->native64);
  if (big_endian.is_tape || native64.is_tape) {
    return native64 > big_endian ? Layout::native64 : Layout::big_endian;
  }
  const auto is_tape = [](const Readings& one, const Readings& other) {
    return one.big_endian.is_tape(other.big_endian) || one.native64.is_tape(other.native64);
  };
  if (!is_tape(*r, *w)) return not_a_tape(*read);
  if (!is_tape(*w, *r)) return not_a_tape(*write);
  return different_layouts(*read, *write);
}

}  // namespace porttape
