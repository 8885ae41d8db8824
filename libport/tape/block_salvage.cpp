#include "libport/tape/block_salvage.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kSure = 8;            // blocks behind one that make it sure
constexpr std::int64_t kMendHeaders = 256;  // that are looked at for one time that is out of order
constexpr std::size_t kChainWindow = 4096;
// What all searches of a file may cost, in nanoseconds: so much for each byte on the disk, and some more.
constexpr std::int64_t kWorkForByte = 200;
constexpr std::int64_t kWorkMore = 50'000'000;
// What is taken for their steps; about what they cost.
constexpr std::int64_t kPriceOfByte = 2;         // that is looked at
constexpr std::int64_t kPriceOfHeader = 20;      // that is parsed
constexpr std::int64_t kPriceOfCall = 1000;      // to the file system
constexpr std::int64_t kPriceOfWindow = 30'000;  // that is read for a search
constexpr std::size_t kSearchedAtOnce = 4096;    // of that window
constexpr std::uint64_t kLookAtMost = std::uint64_t{64} << 20U;
constexpr std::uint64_t kLongest = std::numeric_limits<std::uint32_t>::max();
constexpr std::int64_t kAnyNumber = std::numeric_limits<std::int64_t>::max();
constexpr std::uint64_t kMostPaid = std::uint64_t{1} << 50U;  // bytes
constexpr std::int64_t kMostSilenceUs = std::int64_t{10} * 24 * 3600 * 1'000'000;

// A look at what most offsets fail by.
bool may_be_header(Layout layout, const Byte* p) {
  if (layout == Layout::big_endian) return p[4] == 0 && p[5] <= 0x0f;
  return p[10] <= 0x0f && p[11] == 0 && p[12] == 0 && p[13] == 0 && p[14] == 0 && p[15] == 0;
}

}  // namespace

BlockSalvage::BlockSalvage(std::unique_ptr<ByteSource> source, Layout layout, std::uint64_t size)
    : source_(std::move(source)),
      layout_(layout),
      head_(header_size(layout)),
      size_(size),
      lead_(*source_),
      search_(*source_),
      chain_(*source_, kChainWindow),
      copy_(*source_),
      work_left_(kWorkMore) {
  work_left_ += kWorkForByte * static_cast<std::int64_t>(std::min(stored_.count(size), kMostPaid));
}

Result<BlockSalvage::Step> BlockSalvage::next() {
  while (ready_.empty() && !over_) {
    if (const auto advanced = advance(); !advanced) return advanced.error();
  }
  if (ready_.empty()) return Step{std::exchange(lost_, std::nullopt), std::nullopt};
  Step step = std::move(ready_.front());
  ready_.pop_front();
  return step;
}

std::int64_t BlockSalvage::last_us() const {
  return pending_.empty() ? given_us_ : to_us(pending_.back().at);
}

bool BlockSalvage::is_boundary(std::uint64_t offset) const {
  return std::ranges::any_of(pending_, [&](const SalvagedBlock& block) { return block.offset == offset; });
}

bool BlockSalvage::fits(const BlockHeader& header, std::uint64_t offset) {
  if (header.length > size_ - offset - head_) return false;
  const std::int64_t calls = stored_.calls();
  const bool has_hole = stored_.has_hole(offset, offset + head_ + header.length);
  pay((stored_.calls() - calls) * kPriceOfCall);
  return !has_hole;
}

// Nothing where the file ends before.
Result<std::optional<BlockHeader>> BlockSalvage::header_at(std::uint64_t offset, SourceWindow& window) {
  if (size_ - offset < head_) return std::optional<BlockHeader>{};
  pay(window.holds(offset, head_) ? kPriceOfHeader : kPriceOfCall);
  const auto bytes = window.view(offset, head_);
  if (!bytes) return bytes.error();
  if (bytes->size() < head_) return make_error(Errc::io, name() + " became shorter while it was read");
  return std::optional(parse_header(layout_, bytes->data()));
}

void BlockSalvage::take(const BlockHeader& header, std::int64_t us) {
  const auto length = static_cast<std::uint32_t>(header.length);
  pending_.push_back({tape_time_us(us), scan_, scan_ + head_, length});
  scan_ = pending_.back().end();
}

void BlockSalvage::emit_pending(std::size_t count) {
  for (; count > 0; --count) {
    given_us_ = to_us(pending_.front().at);
    ready_.push_back({std::exchange(lost_, std::nullopt), pending_.front()});
    pending_.pop_front();
  }
}

// In front of the next block that is given.
void BlockSalvage::lose(std::uint64_t from, std::uint64_t bytes, std::string why) {
  if (lost_) {
    lost_->bytes += bytes;
  } else {
    lost_ = LostBytes{from, bytes, tape_time_us(given_us_), std::move(why)};
  }
}

Result<void> BlockSalvage::advance() {
  if (pending_.size() >= kSure) emit_pending(1);
  if (scan_ == size_) {
    emit_pending(pending_.size());
    over_ = true;
    return {};
  }
  if (stored_.behind_hole(scan_) != scan_) return resync("a hole in the file");
  const auto found = header_at(scan_, lead_);
  if (!found) return found.error();
  if (!*found) return resync("an unfinished block");
  const BlockHeader& header = **found;
  const HeaderFault fault = check_header(header, last_us());
  const bool sound_size = fault == HeaderFault::none || fault == HeaderFault::time_back;
  const bool fitting = sound_size && fits(header, scan_);
  if (fault == HeaderFault::none && fitting) {
    mending_ = false;
    take(header, header_time_us(header));
    return {};
  }
  if (fitting) {
    const auto mended = mend_time(header);
    if (!mended) return mended.error();
    if (*mended) return {};
  }
  if (fault == HeaderFault::none)
    return resync(header.length > size_ - scan_ - head_ ? "an unfinished block"
                                                        : "a block with a hole in its data");
  return resync(describe(fault, header, last_us()));
}

// Blocks go on here, but the time goes back: of the two it is the one that does not fit the others.
Result<bool> BlockSalvage::mend_time(const BlockHeader& header) {
  const auto chain = follow(scan_, 0, scan_, kMendHeaders);
  if (!chain) return chain.error();
  if (!chain->strong) return false;
  const std::int64_t us = header_time_us(header);
  const std::uint64_t end = scan_ + head_ + header.length;
  const auto behind = header_at(end, chain_);
  if (!behind) return behind.error();
  const bool next_fits = !*behind || check_header(**behind, last_us()) == HeaderFault::none;
  const std::int64_t before = pending_.size() > 1 ? to_us(pending_[pending_.size() - 2].at) : given_us_;
  const std::string why = describe(HeaderFault::time_back, header, last_us()) +
                          "; the block stays, at the time of the one beside it";
  if (next_fits || pending_.empty() || us < before || mending_) {
    if (!std::exchange(mending_, true)) {
      const std::int64_t last = last_us();
      emit_pending(pending_.size());
      lose(scan_, 0, why);
      take(header, last);
    } else {
      take(header, last_us());
    }
    return true;
  }
  SalvagedBlock& late = pending_.back();
  late.at = tape_time_us(us);
  emit_pending(pending_.size() - 1);
  lose(late.offset, 0, why);
  take(header, us);
  return true;
}

// How far blocks follow one another from here, none earlier than the one before; until that is strong and
// beyond an offset.
Result<BlockSalvage::Chain> BlockSalvage::follow(std::uint64_t offset, std::int64_t not_before_us,
                                                 std::uint64_t beyond, std::int64_t most) {
  std::size_t blocks = 0;  // with data
  for (std::int64_t us = not_before_us;;) {
    if (offset == size_) return Chain{true, offset};
    // A hole is an end, as it is where a machine stopped before its data was on the disk.
    if (size_ - offset < head_ || stored_.behind_hole(offset) != offset) return Chain{blocks > 1, offset};
    if (spent() || --most < 0) return Chain{};
    const auto header = header_at(offset, chain_);
    if (!header) return header.error();
    if (check_header(**header, us) != HeaderFault::none || !fits(**header, offset))
      return Chain{blocks > 2, offset};
    us = header_time_us(**header);
    if ((*header)->length > 0) ++blocks;
    offset += head_ + (*header)->length;
    if (blocks >= kSure && offset > beyond) return Chain{true, offset};
  }
}

// The first offset from which blocks go on that reach beyond another.
Result<std::optional<std::uint64_t>> BlockSalvage::find(std::uint64_t from, std::uint64_t to,
                                                        std::int64_t not_before_us, std::uint64_t beyond) {
  while (from < to && size_ - from >= head_ && !spent()) {
    const std::uint64_t data = stored_.behind_hole(from);
    // A header may begin in the last bytes of a hole.
    if (data - from >= head_) from = data - (head_ - 1);
    if (from >= to || size_ - from < head_) break;
    if (!search_.holds(from, std::min<std::uint64_t>(kSearchedAtOnce, size_ - from))) pay(kPriceOfWindow);
    const auto view = search_.view(from, std::min<std::uint64_t>(kSearchedAtOnce, size_ - from));
    if (!view) return view.error();
    if (view->size() < head_) break;
    const std::size_t count = std::min<std::uint64_t>(view->size() - head_ + 1, to - from);
    for (std::size_t i = 0; i < count; ++i) {
      pay(kPriceOfByte);
      if (!may_be_header(layout_, view->data() + i)) continue;
      pay(kPriceOfHeader);
      const BlockHeader header = parse_header(layout_, view->data() + i);
      if (check_header(header, not_before_us) != HeaderFault::none || !fits(header, from + i)) continue;
      const std::int64_t later = header_time_us(header) - not_before_us;
      if (later > kMostSilenceUs || (header.length == 0 && later == 0) || is_boundary(from + i)) continue;
      const auto chain = follow(from + i, not_before_us, beyond, kAnyNumber);
      if (!chain) return chain.error();
      if (chain->strong && chain->end > beyond) return std::optional(from + i);
      if (spent()) return std::optional<std::uint64_t>{};
    }
    from += count;
  }
  return std::optional<std::uint64_t>{};
}

Result<void> BlockSalvage::resync(const std::string& why) {
  mending_ = false;
  const auto inside = resume_inside(why);
  if (!inside) return inside.error();
  if (*inside) return {};
  for (const std::int64_t not_before : {last_us(), given_us_}) {
    const auto resumed = resume_behind(why, not_before);
    if (!resumed) return resumed.error();
    if (*resumed) return {};
  }
  emit_pending(pending_.size());
  lose(scan_, size_ - scan_,
       spent() ? why + "; the search behind it was given up: too much there looks like blocks and is none"
               : why);
  over_ = true;
  return {};
}

// A length that is too large has swallowed blocks: those go on in the data of a pending one, beyond all of
// these.
Result<bool> BlockSalvage::resume_inside(const std::string& why) {
  if (pending_.empty()) return false;
  const auto found = find(pending_.front().data_offset, scan_, given_us_, scan_);
  if (!found) return found.error();
  if (!*found) return false;
  const auto sound =
      std::ranges::count_if(pending_, [&](const SalvagedBlock& block) { return block.end() <= **found; });
  const std::uint64_t lost_from = pending_.at(static_cast<std::size_t>(sound)).offset;
  pending_.resize(static_cast<std::size_t>(sound));
  resume(**found, lost_from, why);
  return true;
}

Result<bool> BlockSalvage::resume_behind(const std::string& why, std::int64_t not_before_us) {
  const auto found = find(scan_ + 1, size_, not_before_us, scan_);
  if (!found) return found.error();
  if (!*found) return false;
  const auto header = header_at(**found, chain_);
  if (!header) return header.error();
  std::uint64_t lost_from = scan_;
  while (!pending_.empty() && to_us(pending_.back().at) > header_time_us(**header)) {
    lost_from = pending_.back().offset;
    pending_.pop_back();
  }
  resume(**found, lost_from, why);
  return true;
}

// What is pending is sound.
void BlockSalvage::resume(std::uint64_t at, std::uint64_t lost_from, const std::string& why) {
  scan_ = at;
  const std::uint64_t lost = at - lost_from;
  // No block is so small: they belong to the one before, whose length is wrong.
  if (!pending_.empty() && lost < head_ && pending_.back().length + lost <= kLongest) {
    SalvagedBlock& last = pending_.back();
    const std::string mended = "a length of " + std::to_string(last.length) + " is too small by " +
                               std::to_string(lost) + "; the block stays, with them";
    last.length += static_cast<std::uint32_t>(lost);
    const std::uint64_t offset = last.offset;
    emit_pending(pending_.size() - 1);
    lose(offset, 0, mended);
    emit_pending(1);
    return;
  }
  emit_pending(pending_.size());
  lose(lost_from, lost, why);
}

Result<bool> BlockSalvage::holds_blocks(ByteSource& source, Layout layout, std::uint64_t size) {
  struct Shared final : ByteSource {
    explicit Shared(ByteSource& of) : all(of) {}
    Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
      return all.read_at(offset, into);
    }
    Result<std::uint64_t> size() override { return all.size(); }
    Stretch stored(std::uint64_t offset) override { return all.stored(offset); }
    [[nodiscard]] const std::string& name() const override { return all.name(); }
    ByteSource& all;
  };
  BlockSalvage salvage(std::make_unique<Shared>(source), layout, size);
  const auto found = salvage.find(0, std::min(size, kLookAtMost), 0, 0);
  if (!found) return found.error();
  return found->has_value();
}

}  // namespace porttape
