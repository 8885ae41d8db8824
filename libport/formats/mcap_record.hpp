#pragma once

#include <cstdint>
#include <string_view>

namespace porttape::mcap {

// https://mcap.dev/spec: magic, records (a byte of what it is, its length in 8 bytes, content), magic. All
// numbers are little-endian, texts have their length in 4 bytes before them.
inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};
inline constexpr std::size_t kRecordHead = 9;

enum class Op : std::uint8_t {
  header = 1,
  footer,
  schema,
  channel,
  message,
  chunk,
  message_index,
  chunk_index,
  attachment,
  attachment_index,
  statistics,
  metadata,
  metadata_index,
  summary_offset,
  data_end
};

// What a tape has in it: topics, and the metadata `porttape`.
inline constexpr std::string_view kReadTopic = "/serial/read";
inline constexpr std::string_view kWriteTopic = "/serial/write";
inline constexpr std::string_view kEventTopic = "/serial/events";
inline constexpr std::string_view kMetadataName = "porttape";
inline constexpr std::string_view kZeroKey = "zero_us";
inline constexpr std::string_view kHeaderKey = "header";

// Of a message before its data: channel, sequence, two times.
inline constexpr std::size_t kMessageHead = 22;

}  // namespace porttape::mcap
