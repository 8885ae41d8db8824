#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <map>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/formats/crc32.hpp"
#include "libport/formats/mcap_format.hpp"
#include "libport/formats/mcap_record.hpp"
#include "libport/formats/octets.hpp"
#include "libport/formats/tape_wall.hpp"
#include "libport/formats/uart_options.hpp"

namespace porttape {
namespace {

using mcap::Op;

constexpr std::uint64_t kLargestRecord = std::uint64_t{16} << 20U;  // of those that are looked at whole
constexpr std::size_t kPieceOfMessage = std::size_t{64} * 1024;

// Numbers and texts off the front of a record; nothing: it is too short.
class McapFields {
 public:
  explicit McapFields(ByteView bytes) : left_(bytes) {}

  template <std::unsigned_integral Number>
  std::optional<Number> number() {
    if (left_.size() < sizeof(Number)) return std::nullopt;
    const auto number = number_in<Number>(left_, 0, Endian::little);
    left_ = left_.subspan(sizeof(Number));
    return number;
  }
  std::optional<std::string_view> text() {
    const auto size = number<std::uint32_t>();
    if (!size || *size > left_.size()) return std::nullopt;
    const std::string_view text = as_text(left_.first(*size));
    left_ = left_.subspan(*size);
    return text;
  }
  [[nodiscard]] bool over() const { return left_.empty(); }

 private:
  ByteView left_;
};

class McapImport {
 public:
  McapImport(Evidence& from, ImportTape& to) : from_(from), to_(to) {}

  Result<std::optional<TapeTime>> run(const ConvertProgress& progress) {
    Result<UartOptions> options = UartOptions::parse(to_.options().device.value_or(""));
    if (!options) return options.error();
    if (options->rx.empty() && options->tx.empty()) {
      options->rx = mcap::kReadTopic;
      options->tx = mcap::kWriteTopic;
    }
    options_ = std::move(*options);
    const auto magic = read(mcap::kMagic.size());
    if (!magic) return magic.error();
    if (!*magic || as_text(buffer_) != mcap::kMagic)
      return make_error(Errc::not_a_tape, from_.name() + " is no MCAP: it begins otherwise");
    while (!over_) {
      if (Result<void> taken = next(); !taken) return taken.error();
      if (progress) progress(from_.offset());
    }
    if (!begun_) return nothing();
    return ours_ || torn_ ? end_ : std::optional(to_.latest());
  }

 private:
  Result<std::optional<TapeTime>> nothing() {
    if (ours_) {
      if (Result<void> begun = begin(0); !begun) return begun.error();
      return end_;
    }
    return usage_error(fmt::format(
        "{} has no messages of {} or {}; say by --device rx=TOPIC,tx=TOPIC which are the "
        "bytes: {}",
        from_.name(), in_quotes(options_.rx), in_quotes(options_.tx), topics_.empty() ? "none" : topics_));
  }

  [[nodiscard]] Error wrong(std::string_view what) const { return from_.error_at(record_at_, what); }

  Result<void> ends_early() {
    over_ = torn_ = true;
    to_.problem(
        from_.error_at(from_.offset(), fmt::format("it ends within the record at byte {}", record_at_))
            .message);
    return {};
  }

  // Into buffer_, which grows with what is there; false: it is less.
  Result<bool> read(std::uint64_t size) {
    buffer_.clear();
    while (buffer_.size() < size) {
      const std::size_t had = buffer_.size();
      const std::size_t wanted = std::min<std::uint64_t>(size - had, kPieceOfMessage);
      buffer_.resize(had + wanted);
      const auto got = from_.read(std::span(buffer_).subspan(had));
      if (!got) return got.error();
      buffer_.resize(had + *got);
      if (*got < wanted) return false;
    }
    data_crc_.add(buffer_);
    if (chunk_left_ > 0) {
      chunk_left_ -= std::min<std::uint64_t>(chunk_left_, size);
      chunk_crc_.add(buffer_);
    }
    return true;
  }

  Result<void> next() {
    record_at_ = from_.offset();
    const bool in_chunk = chunk_left_ > 0;
    const std::uint64_t left_of_chunk = chunk_left_;
    const Crc32 before = data_crc_;
    if (in_chunk && left_of_chunk < mcap::kRecordHead) return wrong("a chunk that ends within a record");
    const auto head = read(mcap::kRecordHead);
    if (!head) return head.error();
    if (!*head) return ends_early();
    const Op op = static_cast<Op>(buffer_[0]);
    const auto length = number_in<std::uint64_t>(buffer_, 1, Endian::little);
    if (in_chunk && length > left_of_chunk - mcap::kRecordHead)
      return wrong("a record that is longer than its chunk");
    if (in_chunk && op != Op::schema && op != Op::channel && op != Op::message && static_cast<int>(op) < 0x80)
      return wrong("a record that no chunk has");
    if (op == Op::data_end) data_end_crc_ = before.value();
    const Result<void> taken = take(op, length);
    if (!taken) return taken;
    return in_chunk && chunk_left_ == 0 ? check_chunk() : taken;
  }

  Result<void> take(Op op, std::uint64_t length) {
    if (op == Op::message) return message(length);
    if (op == Op::chunk) return chunk(length);
    const bool wanted = op == Op::channel || op == Op::metadata || op == Op::data_end;
    if (op == Op::footer) over_ = true;
    if (!wanted) return skip(length);
    if (length > kLargestRecord) return wrong(fmt::format("a record of {} bytes, more than 16 MiB", length));
    const auto all = read(length);
    if (!all) return all.error();
    if (!*all) return ends_early();
    if (op == Op::channel) return channel();
    return op == Op::metadata ? metadata() : data_end();
  }

  Result<void> skip(std::uint64_t length) {
    while (length > 0 && !torn_) {
      const std::uint64_t size = std::min<std::uint64_t>(length, kPieceOfMessage);
      const auto all = read(size);
      if (!all) return all.error();
      if (!*all) return ends_early();
      length -= size;
    }
    return {};
  }

  Result<void> channel() {
    McapFields fields(buffer_);
    const auto id = fields.number<std::uint16_t>();
    const auto schema = fields.number<std::uint16_t>();
    const auto topic = fields.text();
    if (!id || !schema || !topic) return wrong("a channel that is too short");
    if (topics_.size() < kMostTold && channels_.find(*id) == channels_.end())
      topics_ += (topics_.empty() ? "" : ", ") + printable_line(*topic);
    Channel way = Channel::other;
    if (*topic == options_.rx) way = Channel::read;
    if (*topic == options_.tx) way = Channel::write;
    if (*topic == mcap::kEventTopic && ours_) way = Channel::event;
    channels_[*id] = way;
    return {};
  }

  Result<void> metadata() {
    McapFields fields(buffer_);
    const auto name = fields.text();
    const auto map = fields.text();
    if (!name || !map) return wrong("metadata that is too short");
    if (*name != mcap::kMetadataName || begun_) return {};
    McapFields pairs(as_bytes(*map));
    while (!pairs.over()) {
      const auto key = pairs.text();
      const auto value = pairs.text();
      if (!key || !value) return wrong("metadata whose pairs are too short");
      if (*key == mcap::kHeaderKey) header_line_ = *value;
      const auto zero = *key == mcap::kZeroKey ? whole_number<std::int64_t>(*value) : std::nullopt;
      if (!zero) continue;
      ours_ = true;
      zero_us_ = *zero;
    }
    return {};
  }

  Result<void> data_end() {
    McapFields fields(buffer_);
    const auto crc = fields.number<std::uint32_t>();
    if (crc && *crc != 0 && *crc != data_end_crc_)
      to_.problem(wrong("the checksum of all that stands before is another one").message);
    over_ = true;
    return {};
  }

  // What is in it is read as if it stood outside.
  Result<void> chunk(std::uint64_t length) {
    constexpr std::uint64_t kFixed = 28;
    if (length < kFixed + 4) return wrong("a chunk that is too short");
    const auto fixed = read(kFixed + 4);
    if (!fixed) return fixed.error();
    if (!*fixed) return ends_early();
    const auto crc = number_in<std::uint32_t>(buffer_, 24, Endian::little);
    const auto name_size = number_in<std::uint32_t>(buffer_, kFixed, Endian::little);
    if (name_size > length - kFixed - 4 || name_size > 64)
      return wrong("a chunk whose compression has no sensible name");
    const auto name = read(name_size + 8);
    if (!name) return name.error();
    if (!*name) return ends_early();
    const std::string_view compression = as_text(ByteView(buffer_).first(name_size));
    if (!compression.empty())
      return wrong(
          fmt::format("a chunk that is compressed by {}; make it plain: mcap compress --compression none",
                      in_quotes(compression)));
    const auto size = number_in<std::uint64_t>(buffer_, name_size, Endian::little);
    if (size != length - kFixed - 4 - name_size - 8)
      return wrong("a chunk that has another length than its records");
    chunk_left_ = size;
    wanted_chunk_crc_ = crc;
    chunk_crc_ = Crc32();
    return {};
  }

  Result<void> check_chunk() {
    if (wanted_chunk_crc_ != 0 && wanted_chunk_crc_ != chunk_crc_.value())
      to_.problem(wrong("the checksum of the chunk that ends here is another one").message);
    return {};
  }

  Result<void> message(std::uint64_t length) {
    if (length < mcap::kMessageHead) return wrong("a message that is too short");
    const auto head = read(mcap::kMessageHead);
    if (!head) return head.error();
    if (!*head) return ends_early();
    const auto found = channels_.find(number_in<std::uint16_t>(buffer_, 0, Endian::little));
    const auto ns = number_in<std::uint64_t>(buffer_, 6, Endian::little);
    const std::uint64_t size = length - mcap::kMessageHead;
    if (found == channels_.end()) return wrong("a message of a channel that was not told of");
    if (found->second == Channel::other) return skip(size);
    if (Result<void> begun = begin(ns / 1000); !begun) return begun;
    const TapeTime at = tape_time_us(static_cast<std::int64_t>(ns / 1000) - zero_us_);
    if (found->second == Channel::event) return event(at, size);
    return block(found->second == Channel::read ? Direction::read : Direction::write, at, size);
  }

  Result<void> begin(std::uint64_t us) {
    if (std::exchange(begun_, true)) return {};
    if (!ours_) {
      to_.keep_order();
      zero_us_ = static_cast<std::int64_t>(us);
      to_.wall_of_zero(wall_text(Micros(zero_us_)));
      return to_.event(TapeTime{}, event::Open{});
    }
    to_.sure();
    if (header_line_.empty()) return {};
    const Result<void> taken = to_.header_line(header_line_);
    if (!taken) to_.problem("the header in the metadata is none: " + taken.error().message);
    return {};
  }

  Result<void> event(TapeTime at, std::uint64_t size) {
    if (size > kLargestRecord) return wrong("an event of more than 16 MiB");
    const auto all = read(size);
    if (!all) return all.error();
    if (!*all) return ends_early();
    const std::string line(as_text(buffer_));
    const auto event = decode_event(line);
    if (!event) {
      to_.problem(wrong("an event that is none, left out: " + event.error().message).message);
      return {};
    }
    if (std::holds_alternative<event::End>(event->what)) {
      end_ = at;
      return {};
    }
    return placed(to_.event_line(at, line));
  }

  Result<void> block(Direction way, TapeTime at, std::uint64_t size) {
    if (size > std::numeric_limits<std::uint32_t>::max()) return wrong("a message of more than 4 GiB");
    if (size <= kPieceOfMessage) {
      const auto all = read(size);
      if (!all) return all.error();
      return *all ? placed(to_.block(way, at, buffer_)) : ends_early();
    }
    if (Result<void> begun = to_.begin_block(way, at, static_cast<std::uint32_t>(size)); !begun)
      return placed(begun);
    while (size > 0) {
      const std::uint64_t piece = std::min<std::uint64_t>(size, kPieceOfMessage);
      const auto all = read(piece);
      if (!all) return all.error();
      if (!*all)
        return from_.error_at(from_.offset(),
                              fmt::format("it ends within the message at byte {}", record_at_));
      if (Result<void> added = to_.add(buffer_); !added) return added;
      size -= piece;
    }
    return {};
  }

  [[nodiscard]] Result<void> placed(Result<void> put) const {
    if (!put && put.error().code == Errc::usage) return wrong(put.error().message);
    return put;
  }

  enum class Channel : std::uint8_t { other, read, write, event };
  static constexpr std::size_t kMostTold = 200;

  Evidence& from_;
  ImportTape& to_;
  UartOptions options_;
  std::map<std::uint16_t, Channel> channels_;
  std::string topics_;
  Bytes buffer_;
  std::uint64_t record_at_ = 0;
  std::uint64_t chunk_left_ = 0;
  Crc32 chunk_crc_;
  std::uint32_t wanted_chunk_crc_ = 0;
  Crc32 data_crc_;
  std::uint32_t data_end_crc_ = 0;
  std::string header_line_;
  std::int64_t zero_us_ = 0;
  bool ours_ = false;
  bool begun_ = false;
  bool over_ = false;
  bool torn_ = false;
  std::optional<TapeTime> end_;
};

}  // namespace

Result<std::optional<TapeTime>> import_mcap(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return McapImport(from, to).run(progress);
}

int detect_mcap(std::string_view head) { return head.starts_with(mcap::kMagic) ? 100 : 0; }

}  // namespace porttape
