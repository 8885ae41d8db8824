#include <array>
#include <fmt/format.h>

#include "libport/base/version.hpp"
#include "libport/formats/crc32.hpp"
#include "libport/formats/mcap_format.hpp"
#include "libport/formats/mcap_record.hpp"
#include "libport/formats/octets.hpp"
#include "libport/formats/tape_wall.hpp"
#include "libport/tape/part_writer.hpp"

namespace porttape {
namespace {

using mcap::Op;

constexpr std::uint16_t kEventSchema = 1;

struct McapChannel {
  std::uint16_t id;
  std::string_view topic;
  std::string_view encoding;
  std::uint16_t schema;
};
constexpr std::array<McapChannel, 3> kChannels = {{{1, mcap::kReadTopic, "octets", 0},
                                                   {2, mcap::kWriteTopic, "octets", 0},
                                                   {3, mcap::kEventTopic, "json", kEventSchema}}};

void put_counted(std::string& to, std::string_view text) {
  add_number(to, static_cast<std::uint32_t>(text.size()), Endian::little);
  to += text;
}

template <class Number>
void put_little(std::string& to, Number number) {
  add_number(to, number, Endian::little);
}

class McapExport {
 public:
  McapExport(NewFile& to, std::uint64_t zero) : to_(to), zero_ns_(zero * 1000) {}

  Result<void> begin(std::string_view header_line) {
    if (Result<void> added = add(mcap::kMagic); !added) return added;
    std::string header;
    put_counted(header, "");
    put_counted(header, "porttape " + std::string(version()));
    if (Result<void> added = record(Op::header, header); !added) return added;
    std::string map;
    put_counted(map, mcap::kZeroKey);
    put_counted(map, std::to_string(zero_ns_ / 1000));
    if (!header_line.empty()) {
      put_counted(map, mcap::kHeaderKey);
      put_counted(map, header_line);
    }
    std::string metadata;
    put_counted(metadata, mcap::kMetadataName);
    put_counted(metadata, map);
    if (Result<void> added = record(Op::metadata, metadata); !added) return added;
    return descriptions();
  }

  Result<void> add_record(const Record& record) {
    const McapChannel& channel = kChannels.at(record.event != nullptr           ? 2
                                              : record.kind == RecordKind::read ? 0
                                                                                : 1);
    if (record.piece_offset == 0) {
      const std::size_t length = record.event != nullptr ? record.event_line.size() : record.block_length;
      if (Result<void> begun = begin_message(channel, record.at, length); !begun) return begun;
    }
    return record.event != nullptr ? add(record.event_line) : add(as_text(record.data));
  }

  Result<void> finish() {
    std::string data_end;
    put_little(data_end, crc_.value());
    if (Result<void> added = record(Op::data_end, data_end); !added) return added;
    const std::uint64_t summary = to_.size();
    crc_ = Crc32();
    if (Result<void> added = descriptions(); !added) return added;
    if (Result<void> added = record(Op::statistics, statistics()); !added) return added;
    std::string footer;
    put_little(footer, static_cast<std::uint8_t>(Op::footer));
    put_little(footer, std::uint64_t{20});
    put_little(footer, summary);
    put_little(footer, std::uint64_t{0});
    crc_.add(as_bytes(footer));
    put_little(footer, crc_.value());
    if (Result<void> added = to_.add(footer); !added) return added;
    return to_.add(mcap::kMagic);
  }

 private:
  Result<void> add(std::string_view bytes) {
    crc_.add(as_bytes(bytes));
    return to_.add(bytes);
  }

  Result<void> record(Op op, std::string_view content) {
    std::string head;
    put_little(head, static_cast<std::uint8_t>(op));
    put_little(head, std::uint64_t{content.size()});
    const Result<void> added = add(head);
    return added ? add(content) : added;
  }

  // Schemas and channels.
  Result<void> descriptions() {
    std::string schema;
    put_little(schema, kEventSchema);
    put_counted(schema, "porttape.Event");
    put_counted(schema, "jsonschema");
    put_counted(schema, R"({"type":"object"})");
    if (Result<void> added = record(Op::schema, schema); !added) return added;
    for (const McapChannel& channel : kChannels) {
      std::string content;
      put_little(content, channel.id);
      put_little(content, channel.schema);
      put_counted(content, channel.topic);
      put_counted(content, channel.encoding);
      put_counted(content, "");
      if (Result<void> added = record(Op::channel, content); !added) return added;
    }
    return {};
  }

  Result<void> begin_message(const McapChannel& channel, TapeTime at, std::size_t length) {
    const std::uint64_t ns = zero_ns_ + static_cast<std::uint64_t>(to_us(at)) * 1000;
    std::string head;
    put_little(head, static_cast<std::uint8_t>(Op::message));
    put_little(head, std::uint64_t{mcap::kMessageHead + length});
    put_little(head, channel.id);
    put_little(head, static_cast<std::uint32_t>(counts_.at(channel.id - 1U)));
    put_little(head, ns);
    put_little(head, ns);
    ++counts_.at(channel.id - 1U);
    if (!first_ns_) first_ns_ = ns;
    last_ns_ = ns;
    return add(head);
  }

  [[nodiscard]] std::string statistics() const {
    std::string content;
    std::string by_channel;
    std::uint64_t all = 0;
    for (const McapChannel& channel : kChannels) {
      put_little(by_channel, channel.id);
      put_little(by_channel, counts_.at(channel.id - 1U));
      all += counts_.at(channel.id - 1U);
    }
    put_little(content, all);
    put_little(content, std::uint16_t{1});  // schemas
    put_little(content, std::uint32_t{kChannels.size()});
    put_little(content, std::uint32_t{0});  // attachments
    put_little(content, std::uint32_t{1});  // metadata
    put_little(content, std::uint32_t{0});  // chunks
    put_little(content, first_ns_.value_or(0));
    put_little(content, last_ns_);
    put_counted(content, by_channel);
    return content;
  }

  NewFile& to_;
  std::uint64_t zero_ns_;
  Crc32 crc_;  // of the data section, then of the summary
  std::array<std::uint64_t, 3> counts_{};
  std::optional<std::uint64_t> first_ns_;
  std::uint64_t last_ns_ = 0;
};

}  // namespace

Result<std::vector<std::string>> export_mcap(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  McapExport out(to, wall_us_of_zero(from.header()));
  if (Result<void> begun = out.begin(from.header_line()); !begun) return begun.error();
  std::uint64_t bytes = 0;
  for (;;) {
    const auto next = from.next();
    if (!next) return next.error();
    if (!*next) break;
    if (Result<void> added = out.add_record(**next); !added) return added.error();
    if (progress) progress(bytes += bytes_in_file(**next));
  }
  if (Result<void> finished = out.finish(); !finished) return finished.error();
  return std::vector<std::string>{};
}

}  // namespace porttape
