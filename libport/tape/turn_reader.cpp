#include "libport/tape/turn_reader.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <iterator>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kMostEvents = 1024;
constexpr std::size_t kShortestPart = 16;
constexpr std::size_t kLongestPart = std::size_t{4} * 1024 * 1024;
constexpr unsigned kPartBits = 10;  // a part without lines has 1024 bytes, or some
constexpr unsigned kRunBits = 20;   // parts become longer with each doubling of so long a run

// A number for each byte whose sum over the last 64 bytes decides where to cut.
constexpr std::array<std::uint64_t, 256> make_gears() {
  std::array<std::uint64_t, 256> gears{};
  std::uint64_t state = 0;
  for (std::uint64_t& gear : gears) {
    state += 0x9E3779B97F4A7C15U;
    std::uint64_t mixed = (state ^ (state >> 30U)) * 0xBF58476D1CE4E5B9U;
    mixed = (mixed ^ (mixed >> 27U)) * 0x94D049BB133111EBU;
    gear = mixed ^ (mixed >> 31U);
  }
  return gears;
}
constexpr std::array<std::uint64_t, 256> kGears = make_gears();

bool high_bits_are_zero(std::uint64_t value, unsigned bits) { return bits == 0 || value >> (64 - bits) == 0; }

}  // namespace

Result<const Turn*> TurnReader::next() {
  while (ready_.empty() && !ended_) {
    const Result<std::optional<Record>> record = source_.next();
    if (!record) return record.error();
    if (*record) {
      if (options_.progress) options_.progress(bytes_ += bytes_in_file(**record));
      take(**record);
    } else {
      finish();
      ended_ = true;
    }
  }
  if (ready_.empty()) return static_cast<const Turn*>(nullptr);
  given_ = std::move(ready_.front());
  ready_.pop_front();
  ++count_;
  return static_cast<const Turn*>(&given_);
}

void TurnReader::take(const Record& record) {
  switch (record.kind) {
    case RecordKind::write:
      return take_data(record, true);
    case RecordKind::read:
      return take_data(record, false);
    case RecordKind::open:
    case RecordKind::close:
      exchanges_.on_open_or_close();
      finish();
      part_ = 0;
      run_ = rolling_ = 0;
      if (record.kind == RecordKind::open) last_ = record.at;
      break;
    default:
      break;
  }
  take_event(record);
}

void TurnReader::take_event(const Record& record) {
  if (!options_.events || record.event == nullptr || std::holds_alternative<event::End>(*record.event) ||
      std::holds_alternative<event::Zero>(*record.event))
    return;
  if (events_.size() >= kMostEvents) finish();
  Turn& turn = (turn_ ? events_ : ready_).emplace_back();
  turn.exchange = static_cast<std::uint32_t>(exchanges_.count());
  turn.at = turn.until = record.at;
  turn.event = *record.event;
  turn.line = record.event_line;
}

void TurnReader::take_data(const Record& record, bool writes) {
  if (record.piece_offset == 0) {
    if (writes && exchanges_.on_write()) {
      finish();
      part_ = 0;
      begin(Turn::Kind::exchange, record.at);
    }
    const bool answers = !writes && exchanges_.on_read();
    if (writes != writing_) run_ = rolling_ = 0;
    writing_ = writes;
    if (!turn_) begin(part_ > 0 ? Turn::Kind::part : Turn::Kind::unasked, record.at);
    if (writes) asked_ = record.at;
    if (answers) turn_->answer = record.at - asked_;
  }
  append(record.data, record.at, writes);
}

void TurnReader::begin(Turn::Kind kind, TapeTime at) {
  turn_.emplace();
  turn_->kind = kind;
  turn_->exchange = static_cast<std::uint32_t>(exchanges_.count());
  turn_->part = part_;
  turn_->at = at;
  turn_->wait = at - last_;
}

// Ends the turn; where the run goes on, a part of the same exchange comes next.
void TurnReader::finish() {
  if (turn_) ready_.push_back(std::move(*turn_));
  turn_.reset();
  std::move(events_.begin(), events_.end(), std::back_inserter(ready_));
  events_.clear();
  ++part_;
}

bool TurnReader::ends_here(Byte byte, std::size_t size) {
  rolling_ = (rolling_ << 1U) + kGears[byte];
  if (run_ <= kLongRun || size < kShortestPart) return false;
  const auto doublings = static_cast<unsigned>(std::bit_width(run_ >> kRunBits));
  return (byte == '\n' && high_bits_are_zero(rolling_, doublings)) ||
         high_bits_are_zero(rolling_, kPartBits + doublings) || size >= kLongestPart;
}

void TurnReader::append(ByteView data, TapeTime at, bool writes) {
  last_ = at;
  if (run_ + data.size() <= kLongRun) {
    porttape::append(writes ? turn_->writes : turn_->reads, data);
    run_ += data.size();
    turn_->until = at;
    return;
  }
  while (!data.empty()) {
    if (!turn_) begin(Turn::Kind::part, at);
    Bytes& into = writes ? turn_->writes : turn_->reads;
    std::size_t size = 0;
    bool ends = false;
    while (size < data.size() && !ends) {
      const Byte byte = data[size++];
      ++run_;
      ends = ends_here(byte, into.size() + size);
    }
    porttape::append(into, data.first(size));
    data = data.subspan(size);
    turn_->until = at;
    if (ends) finish();
  }
}

}  // namespace porttape
