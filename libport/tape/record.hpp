#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/tape/event.hpp"

namespace porttape {

// As the driver sees it: `read` is device → driver (the r file), `write` is driver → device (the w file).
enum class Direction : std::uint8_t { read, write };

// `hang_up`: the device went away and the driver's line broke (a device-lost event that says so).
// `half_close`: one side has sent its last byte and still reads (its event says which). `gap`: bytes are
// missing from here on, or did not reach the other side.
enum class RecordKind : std::uint8_t { read, write, open, close, hang_up, half_close, gap, event };

// Tells of something, and is no step of the conversation.
constexpr bool is_note(RecordKind kind) { return kind == RecordKind::event || kind == RecordKind::gap; }

// One step of a tape. A block larger than the reader's buffer comes in pieces that share its time, so memory
// stays constant; a block that fits is one piece (piece_offset 0, data.size() == block_length).
struct Record {
  RecordKind kind = RecordKind::event;
  TapeTime at{};
  ByteView data;                    // read and write: the piece; valid until the source's next call
  std::uint64_t stream_offset = 0;  // read and write: bytes of this direction before this piece
  std::uint64_t file_offset = 0;    // read and write: where the block's header starts in its file
  std::uint32_t block_length = 0;
  std::uint32_t piece_offset = 0;
  // All kinds but read and write: the event and the whole JSON object; both valid until the source's next
  // call.
  const Event* event = nullptr;
  std::string_view event_line{};

  [[nodiscard]] bool last_piece() const { return piece_offset + data.size() == block_length; }
};

// Delivers the records of a tape in order. Implemented by TapeReader on files and by tests in memory.
class RecordSource {
 public:
  virtual ~RecordSource() = default;

  // The next record; nothing at the tape's end (a torn tail is an end). After an error every further call
  // gives it again.
  virtual Result<std::optional<Record>> next() = 0;

  // Starts again at the first record.
  virtual Result<void> rewind() = 0;
};

}  // namespace porttape
