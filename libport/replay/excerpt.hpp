#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/give_up.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What the tape has of one request: a line, or what was written in one go. Plain value.
struct TapeFrame {
  Bytes bytes;                 // at most kMostBytes of them
  std::uint64_t length = 0;    // all of them
  std::uint64_t offset = 0;    // of the first, in the tape's stream of writes
  std::uint64_t exchange = 0;  // 1-based: a run of writes and its answer
  std::uint32_t part = 1;      // 1-based: which frame of the exchange's …
  std::uint32_t parts = 1;     // … so many
  TapeTime begun{};            // the first byte's time
  TapeTime at{};               // the last byte's time

  static constexpr std::size_t kMostBytes = 1024;

  // Whether these are exactly its bytes.
  [[nodiscard]] bool is(ByteView other) const;
  friend bool operator==(const TapeFrame&, const TapeFrame&) = default;
};

// What the tape has as the answer to one exchange's request; after the last of its frames.
struct TapeAnswer {
  Bytes bytes;               // at most kMostBytes of them
  std::uint64_t length = 0;  // all of them
  std::uint64_t offset = 0;  // of the first, in the tape's stream of reads
  TapeTime begun{};
  TapeTime at{};

  static constexpr std::size_t kMostBytes = 16384;

  friend bool operator==(const TapeAnswer&, const TapeAnswer&) = default;
};

// A few exchanges of a tape around one place. Plain value, bounded: kReach frames either side.
struct TapeExcerpt {
  static constexpr std::size_t kReach = 32;

  struct Step {
    TapeFrame frame;
    std::optional<TapeAnswer> answer;  // to the exchange that ends with the frame; nothing: it goes on
    friend bool operator==(const Step&, const Step&) = default;
  };

  std::vector<Step> steps;
  std::size_t place = 0;    // index of the step that holds the offset asked for; steps.size(): the tape's end
  bool from_start = false;  // the first step is the tape's first
  bool to_end = false;      // the last one its last
  bool lines = false;       // requests are lines of text
  friend bool operator==(const TapeExcerpt&, const TapeExcerpt&) = default;
};

// On the tape, between writes that are no one frame.
constexpr Micros kFrameGap{500};

// Where the frames of one exchange's request end, in rising order, the last at its size. `blocks`: where the
// recorded writes end that came apart from the next.
using FrameEnds =
    std::function<std::vector<std::size_t>(ByteView request, const std::vector<std::size_t>& blocks)>;

// The excerpt around `offset` of the tape's stream of writes. Frames are found from the bytes themselves: the
// lines of a request of text, else the writes that are at least `burst_gap` apart; or by `frame_ends`. Reads
// all that stands before; rewinds `tape` and leaves it anywhere. Nothing when given up, or where the tape
// cannot be read.
std::optional<TapeExcerpt> read_excerpt(RecordSource& tape, std::uint64_t offset, Micros burst_gap,
                                        const GiveUp& give_up = {}, const FrameEnds& frame_ends = {});

// Leaves out what precedes the place and was not played, since the tape was played from `start` on.
void begin_at(TapeExcerpt& excerpt, TapeTime start);

}  // namespace porttape
