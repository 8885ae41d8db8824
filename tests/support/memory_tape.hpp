#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/replay/answer_source.hpp"
#include "libport/replay/report.hpp"
#include "libport/tape/record.hpp"

namespace porttape::test {

// A tape written down in a test, in merged order.
class MemoryTape {
 public:
  struct Entry {
    RecordKind kind = RecordKind::event;
    std::int64_t us = 0;
    std::string data;
    Event event{};  // of a gap or an event
  };

  MemoryTape& read(std::int64_t us, std::string_view data) { return add(RecordKind::read, us, data); }
  MemoryTape& write(std::int64_t us, std::string_view data) { return add(RecordKind::write, us, data); }
  MemoryTape& open(std::int64_t us) { return add(RecordKind::open, us, {}); }
  MemoryTape& close(std::int64_t us) { return add(RecordKind::close, us, {}); }
  MemoryTape& hang_up(std::int64_t us) { return add(RecordKind::hang_up, us, {}); }
  MemoryTape& half_close(std::int64_t us, Side by) {
    entries_.push_back({RecordKind::half_close, us, {}, event::HalfClose{by}});
    return *this;
  }
  MemoryTape& gap(std::int64_t us, std::uint64_t bytes, std::int64_t from_us) {
    entries_.push_back({RecordKind::gap, us, {}, event::Gap{bytes, tape_time_us(from_us), "disk full"}});
    return *this;
  }
  MemoryTape& event(std::int64_t us, Event event) {
    entries_.push_back({RecordKind::event, us, {}, std::move(event)});
    return *this;
  }

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] std::string all(RecordKind kind) const {
    std::string out;
    for (const Entry& entry : entries_) {
      if (entry.kind == kind) out += entry.data;
    }
    return out;
  }
  [[nodiscard]] std::vector<TapeGap> gaps() const {
    std::vector<TapeGap> gaps;
    for (const Entry& entry : entries_) {
      if (const auto* gap = std::get_if<event::Gap>(&entry.event)) {
        gaps.push_back({gap->from.value(), tape_time_us(entry.us), gap->bytes, gap->why});
      }
    }
    return gaps;
  }
  // When each hang-up was.
  [[nodiscard]] std::vector<TapeTime> hang_ups() const {
    std::vector<TapeTime> times;
    for (const Entry& entry : entries_) {
      if (entry.kind == RecordKind::hang_up) times.push_back(tape_time_us(entry.us));
    }
    return times;
  }
  // When the session began that `us` is in; without opens, the tape's beginning.
  [[nodiscard]] std::optional<TapeTime> open_before(std::int64_t us) const {
    std::optional<TapeTime> begin = opens() == 0 ? std::optional(TapeTime{}) : std::nullopt;
    for (const Entry& entry : entries_) {
      if (entry.us > us) break;
      if (entry.kind == RecordKind::open) begin = tape_time_us(entry.us);
      if (entry.kind == RecordKind::close) begin.reset();
    }
    return begin;
  }
  [[nodiscard]] std::uint64_t opens() const {
    return static_cast<std::uint64_t>(std::count_if(
        entries_.begin(), entries_.end(), [](const Entry& entry) { return entry.kind == RecordKind::open; }));
  }

 private:
  MemoryTape& add(RecordKind kind, std::int64_t us, std::string_view data) {
    entries_.push_back({kind, us, std::string(data)});
    return *this;
  }

  std::vector<Entry> entries_;
};

// Plays a MemoryTape as a RecordSource: all of it, or only its writes. Refers to the tape. Blocks come in
// pieces of at most `piece` bytes; call number `fail_at` of next() (counted from 0, over all rewinds) and all
// after it fail.
class MemorySource final : public RecordSource {
 public:
  enum class Select : std::uint8_t { merged, writes_only };

  explicit MemorySource(const MemoryTape& tape, Select select = Select::merged,
                        std::size_t piece = std::numeric_limits<std::size_t>::max())
      : tape_(tape), select_(select), piece_(piece) {}

  void fail_at(std::size_t call) { fail_at_ = call; }
  [[nodiscard]] std::size_t calls() const { return calls_; }
  [[nodiscard]] std::size_t rewinds() const { return rewinds_; }

  Result<std::optional<Record>> next() override {
    if (calls_++ >= fail_at_) return make_error(Errc::damaged_tape, "damaged at block 7");
    const auto& entries = tape_.entries();
    while (index_ < entries.size() && select_ == Select::writes_only &&
           entries[index_].kind != RecordKind::write)
      ++index_;
    if (index_ >= entries.size()) return std::optional<Record>{};
    return std::optional<Record>{piece_of(entries[index_])};
  }

  Result<void> rewind() override {
    ++rewinds_;
    go_to(0, 0);
    writes_ = 0;
    return {};
  }
  // Where an entry begins, by the number that its records have as file_offset.
  void go_to(std::size_t index, std::uint64_t reads) {
    index_ = index;
    taken_ = 0;
    reads_ = reads;
  }

 private:
  Record piece_of(const MemoryTape::Entry& entry) {
    Record record;
    record.file_offset = index_;
    record.kind = entry.kind;
    record.at = tape_time_us(entry.us);
    if (is_note(entry.kind) || entry.kind == RecordKind::half_close) record.event = &entry.event;
    if (entry.kind == RecordKind::read || entry.kind == RecordKind::write) {
      const ByteView data = as_bytes(entry.data);
      const std::size_t size = std::min(piece_, data.size() - taken_);
      std::uint64_t& stream = entry.kind == RecordKind::read ? reads_ : writes_;
      // A copy, so that a view kept too long shows under AddressSanitizer.
      buffer_ = Bytes(data.begin() + static_cast<std::ptrdiff_t>(taken_),
                      data.begin() + static_cast<std::ptrdiff_t>(taken_ + size));
      record.data = buffer_;
      record.stream_offset = stream;
      record.block_length = static_cast<std::uint32_t>(data.size());
      record.piece_offset = static_cast<std::uint32_t>(taken_);
      stream += size;
      taken_ += size;
      if (taken_ < data.size()) return record;
    }
    taken_ = 0;
    ++index_;
    return record;
  }

  const MemoryTape& tape_;
  Select select_;
  std::size_t piece_;
  std::size_t index_ = 0;
  std::size_t taken_ = 0;
  std::uint64_t reads_ = 0;
  std::uint64_t writes_ = 0;
  std::size_t calls_ = 0;
  std::size_t rewinds_ = 0;
  std::size_t fail_at_ = std::numeric_limits<std::size_t>::max();
  Bytes buffer_;
};

// The reads of a MemoryTape from anywhere on. Refers to the tape.
class MemoryAnswers final : public AnswerSource {
 public:
  explicit MemoryAnswers(const MemoryTape& tape, std::size_t piece = std::numeric_limits<std::size_t>::max())
      : source_(tape, MemorySource::Select::merged, piece) {}

  MemorySource& source() { return source_; }

  Result<void> seek(std::uint64_t file_offset, std::uint64_t reads) override {
    source_.go_to(file_offset, reads);
    return {};
  }
  Result<std::optional<Record>> next() override {
    while (true) {
      auto record = source_.next();
      if (!record || !*record || (*record)->kind == RecordKind::read) return record;
    }
  }

 private:
  MemorySource source_;
};

}  // namespace porttape::test
