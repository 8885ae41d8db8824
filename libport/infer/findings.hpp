#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/infer/align.hpp"
#include "libport/infer/counters.hpp"
#include "libport/infer/frame_sort.hpp"
#include "libport/infer/session_tape.hpp"
#include "libport/infer/text_parts.hpp"

namespace porttape {

// Something in frames of one kind that differs between sessions.
struct FoundField {
  enum class What {
    bytes,    // `size` bytes at `at`
    counter,  // the same, a binary number
    word,     // of a text: a part of its word number `word`
    middle    // all from `at` to `tail` bytes before the body's end, of any length
  };
  What what = What::bytes;
  std::size_t at = 0;
  std::size_t size = 0;
  std::size_t tail = 0;
  bool little_endian = false;          // counter
  std::optional<std::int64_t> step{};  // of a counter, or of a word that counts
  int base = 10;                       // of a word that counts
  std::size_t word = 0;
  WordPattern pattern{};
  std::size_t shortest = 0;  // of a word's part and of a middle, as far as seen
  std::size_t longest = 0;
  std::size_t places = 0;  // where frames were compared and differ there
};

// Frames that are alike: of one sort, with one key, and but for `middle` fields of one size or, texts, with
// the same marks.
struct FoundKind {
  std::size_t sort = 0;
  std::size_t key_at = 0;
  Bytes key{};                         // stands there
  std::optional<std::size_t> size{};   // of all
  std::optional<std::string> marks{};  // of all bodies
  std::vector<FoundField> fields{};
  std::vector<FrameRun> runs{};   // the frames, tape by tape
  std::vector<ByteView> alone{};  // those of them without a counterpart in another session
  bool in_all = false;            // some stand at the same place in all sessions

  [[nodiscard]] std::size_t frames() const;
};

struct FoundSort {
  FrameSort sort{};
  std::vector<FoundField> counters{};  // that go on from each frame to the next, whatever its kind

  // Without its checksum and what is behind that; of a text also without its end.
  [[nodiscard]] ByteView body(ByteView frame) const;
};

struct Findings {
  std::vector<FoundSort> sorts{};
  std::vector<FoundKind> kinds{};
  std::map<const Byte*, ByteView>
      answers{};                // to frames, by where these begin; their first frames, of the same sort
  std::string why{};            // these sorts
  std::size_t frames = 0;       // that were compared
  std::size_t left_out = 0;     // frames at the ends of long sessions
  std::size_t other_bytes = 0;  // of no frame
};

// What sessions of one driver have in common and what differs. Refers to the sessions. Compares the first
// 2000 frames of each.
Findings find_differences(std::span<const SessionTape> sessions);

}  // namespace porttape
