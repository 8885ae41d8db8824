#include "libport/replay/request_index.hpp"

#include <algorithm>
#include <cstring>
#include <functional>
#include <string_view>
#include <utility>

#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::size_t kChunk = std::size_t{64} << 10;
// Of what a text and an exchange cost beside their bytes.
constexpr std::size_t kTextCost = 160;
constexpr std::size_t kExchangeCost = 72;

std::size_t hash_of(ByteView bytes) { return std::hash<std::string_view>{}(as_text(bytes)); }

Error too_large(TapeTime at, std::size_t exchanges, std::size_t most_bytes) {
  return make_error(Errc::usage, "the index of what was asked on the tape would need more than " +
                                     std::to_string(most_bytes >> 20U) + " MiB (from " +
                                     seconds_text(to_us(at)) + " on, behind " + std::to_string(exchanges) +
                                     " requests): play one session of it (--session N), or use --match "
                                     "sequence");
}

}  // namespace

bool RequestIndex::read_on() {
  if (!begun_) {
    begun_ = true;
    if (auto rewound = tape_.rewind(); !rewound) error_ = rewound.error();
  }
  while (!whole_ && !error_ && !budget_.spent()) {
    auto record = tape_.next();
    if (!record) {
      error_ = record.error();
    } else if (!*record) {
      end_session();
      sort();
      whole_ = !error_;
    } else {
      budget_.spend((*record)->data.size());
      take(**record);
    }
  }
  return whole_;
}

std::uint32_t RequestIndex::exchange_at(std::uint64_t writes) const {
  const auto end = [this](const Exchange& each) { return each.writes + texts_[each.text].bytes.size(); };
  const auto at = std::ranges::upper_bound(exchanges_, writes, {}, end);
  return static_cast<std::uint32_t>(at - exchanges_.begin());
}

void RequestIndex::take(const Record& record) {
  switch (record.kind) {
    case RecordKind::write:
      return take_write(record);
    case RecordKind::read:
      return take_read(record);
    case RecordKind::hang_up:
      return take_end(record, End::hang_up);
    case RecordKind::half_close: {
      const auto* half_close = std::get_if<event::HalfClose>(record.event);
      if (half_close != nullptr && half_close->by == Side::device) take_end(record, End::half_close);
      return;
    }
    case RecordKind::open:
    case RecordKind::close:
      end_session();
      line_closed_ = record.kind == RecordKind::close;
      return;
    case RecordKind::gap:
    case RecordKind::event:
      return;
  }
}

void RequestIndex::take_write(const Record& record) {
  if (record.data.empty()) return;
  answering_ = false;
  if (question_.empty()) asked_ = {.writes = writes_, .began = record.at};
  question_.insert(question_.end(), record.data.begin(), record.data.end());
  asked_.asked = record.at;
  if (record.piece_offset > 0 && !blocks_.empty()) blocks_.pop_back();
  blocks_.push_back({static_cast<std::uint32_t>(question_.size()), record.at});
  writes_ += record.data.size();
  if (question_.size() + bytes_ > most_bytes_) add_bytes(question_.size(), record.at);
}

void RequestIndex::take_read(const Record& record) {
  if (record.data.empty()) return;
  end_question();
  const std::uint64_t before = std::exchange(reads_, reads_ + record.data.size());
  if (!answering_ || line_closed_) return;
  Exchange& exchange = exchanges_.back();
  if (exchange.end == End::hang_up) return;
  if (exchange.answer_size == 0) {
    exchange.file_offset = record.file_offset;
    exchange.reads = before;
  }
  exchange.answer_size += record.data.size();
}

void RequestIndex::take_end(const Record& record, End end) {
  end_question();
  if (!answering_ || line_closed_ || exchanges_.back().end == End::hang_up) return;
  exchanges_.back().end = end;
  exchanges_.back().ended = record.at;
}

void RequestIndex::end_session() {
  end_question();
  answering_ = false;
}

void RequestIndex::end_question() {
  if (question_.empty() || error_) return;
  asked_.text = intern();
  const auto at = static_cast<std::uint32_t>(exchanges_.size());
  exchanges_.push_back(asked_);
  add_bytes(kExchangeCost, asked_.began);
  Text& text = texts_[asked_.text];
  if (text.kind == kNone) text.kind = kind_of(asked_.text);
  Kind& kind = kinds_[text.kind];
  if (kind.last != kNone) exchanges_[kind.last].next = at;
  if (kind.first == kNone) kind.first = at;
  kind.last = at;
  question_.clear();
  blocks_.clear();
  answering_ = true;
}

// The text that the question is, known or new.
std::uint32_t RequestIndex::intern() {
  const std::size_t hash = hash_of(question_);
  const auto [begin, end] = by_hash_.equal_range(hash);
  for (auto known = begin; known != end; ++known) {
    const ByteView bytes = texts_[known->second].bytes;
    if (std::equal(bytes.begin(), bytes.end(), question_.begin(), question_.end())) return known->second;
  }
  const auto at = static_cast<std::uint32_t>(texts_.size());
  Text text{keep(question_), kNone, {}};
  if (blocks_.size() > 1) text.blocks = blocks_;
  add_bytes(kTextCost + question_.size() + text.blocks.size() * sizeof(Block), asked_.began);
  texts_.push_back(std::move(text));
  by_hash_.emplace(hash, at);
  return at;
}

std::uint32_t RequestIndex::kind_of(std::uint32_t text) {
  const ByteView came = texts_[text].bytes;
  for (std::uint32_t known = 0; expectation_ != nullptr && known < kinds_.size(); ++known) {
    budget_.spend(came.size());
    if (may_come_for(kinds_[known].first, came)) return known;
  }
  kinds_.push_back({});
  return static_cast<std::uint32_t>(kinds_.size() - 1);
}

// Whether it is all of what that request may be.
bool RequestIndex::may_come_for(std::uint32_t exchange, ByteView came) {
  Comparison comparison(expectation_);
  const std::size_t size = request(exchange).size();
  std::size_t used = 0;
  std::size_t taken = 0;
  bool goes_on = false;
  while (used < size) {
    const Expectation::Held held = comparison.hold(stretch(exchange, used), came.subspan(taken));
    if (held.differs || (held.recorded == 0 && held.came == 0)) return false;
    used += held.recorded;
    taken += held.came;
    goes_on = held.goes_on;
  }
  return used == size && taken == came.size() && !goes_on;
}

ByteView RequestIndex::keep(ByteView bytes) {
  if (bytes.size() > chunk_left_ || chunks_.empty()) {
    chunk_left_ = std::max(kChunk, bytes.size());
    chunks_.push_back(std::make_unique_for_overwrite<Byte[]>(chunk_left_));
  }
  // Chunks are filled from their ends.
  Byte* const place = chunks_.back().get() + chunk_left_ - bytes.size();
  std::memcpy(place, bytes.data(), bytes.size());
  chunk_left_ -= bytes.size();
  return {place, bytes.size()};
}

void RequestIndex::add_bytes(std::size_t count, TapeTime at) {
  bytes_ += count;
  if (bytes_ > most_bytes_ && !error_) error_ = too_large(at, exchanges_.size(), most_bytes_);
}

void RequestIndex::sort() {
  if (expectation_ != nullptr) return;
  for (std::uint32_t kind = 0; kind < kinds_.size(); ++kind) sorted_.push_back(kind);
  std::ranges::sort(sorted_, [this](std::uint32_t one, std::uint32_t other) {
    return std::ranges::lexicographical_compare(kind_request(one), kind_request(other));
  });
}

Expectation::Stretch RequestIndex::stretch(std::uint32_t exchange, std::size_t used) const {
  const Exchange& asked = exchanges_[exchange];
  const Text& text = texts_[asked.text];
  std::size_t begin = 0;
  std::size_t end = text.bytes.size();
  std::size_t ahead_end = end;
  TapeTime at = asked.asked;
  if (!text.blocks.empty()) {
    auto block = std::ranges::find_if(text.blocks, [used](const Block& each) { return used < each.end; });
    begin = block == text.blocks.begin() ? 0 : std::prev(block)->end;
    end = block->end;
    at = block->at;
    const Micros pause = expectation_ == nullptr ? Micros::max() : expectation_->reach().pause;
    for (auto next = std::next(block); next != text.blocks.end(); ++next, ++block) {
      if (next->at - block->at >= pause) {
        ahead_end = block->end;
        break;
      }
    }
  }
  return {.bytes = text.bytes.subspan(used, end - used),
          .before = text.bytes.subspan(begin, used - begin),
          .offset = asked.writes + used,
          .in_block = static_cast<std::uint32_t>(used - begin),
          .ends_block = true,
          .at = at,
          .ahead = text.bytes.subspan(end, ahead_end - end),
          .ahead_ends = true};
}

}  // namespace porttape
