#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/stranger_text.hpp"
#include "libport/base/time.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What a rules file says, as values: RULES.md beside this file has the meaning of every key. read_rules()
// makes one of a file's text and has checked it; to_toml() makes a text of one.

// Where it stands in its file; 0: in none. Of no matter to what it says.
struct RuleLine {
  int number = 0;
  friend bool operator==(const RuleLine&, const RuleLine&) { return true; }
};

enum class ByteOrder : std::uint8_t { big, little };

// How a number is written in its bytes.
enum class NumberType : std::uint8_t { unsigned_, signed_, decimal, hex };

// Where in a frame something stands; found in the recorded frame and in the one that came, each by itself.
// Positions count from 0, negative ones from the frame's end.
struct Place {
  enum class By : std::uint8_t { bytes, column, capture };
  By by = By::bytes;
  // bytes: from `at`, `size` of them, or up to (not with) `to`, or, with neither, to the frame's end.
  std::int64_t at = 0;
  std::optional<std::int64_t> size{};
  std::optional<std::int64_t> to{};
  // column: the n-th, from 0, between separators; the last ends before the frame's checksum and end.
  int column = 0;
  std::string separator = ",";
  // capture: the first group of this expression, searched for in the frame.
  std::string capture{};

  friend bool operator==(const Place&, const Place&) = default;
};

// A checksum that the frame holds, computed anew.
struct ChecksumField {
  std::string kind{};                // of checksum_kinds(): "CRC-16/MODBUS", "xor", …
  std::int64_t at = 0;               // its first byte; negative: from the frame's end
  std::int64_t from = 0;             // of the bytes that it is of
  std::optional<std::int64_t> to{};  // behind the last of them; absent: its own first byte
  ByteOrder order = ByteOrder::big;
  bool hex = false;            // as hexadecimal digits, two a byte
  bool of_hex = false;         // what it is of are such digits, too: it is of the bytes that they stand for
  bool mavlink_extra = false;  // MAVLink's CRC_EXTRA of the message goes in last

  friend bool operator==(const ChecksumField&, const ChecksumField&) = default;
};

// A number in the frame that tells how long it is.
struct LengthField {
  std::int64_t at = 0;
  std::int64_t size = 1;  // bytes: 1 to 4
  ByteOrder order = ByteOrder::big;
  std::int64_t adds = 0;  // the frame's length is the number and so many more
  // MAVLink 2: 13 more where this bit of the byte at `signed_at` is set.
  std::optional<std::int64_t> signed_at{};

  friend bool operator==(const LengthField&, const LengthField&) = default;
};

// How frames are cut out of what the driver writes (and, for replies, out of answers).
struct FrameFormat {
  enum class Kind : std::uint8_t { delimited, length, fixed, idle };
  StrangerText name{};
  std::string protocol{};  // of protocol_names(); else empty. All that follows is filled in by it
  Kind kind = Kind::delimited;
  Bytes start{};               // what a frame begins with; empty: anything
  Bytes end{};                 // delimited
  std::size_t trailer = 0;     // delimited: so many bytes behind the end are the frame's, too
  LengthField length{};        // length
  std::size_t size = 0;        // fixed
  Micros idle{};               // idle: a frame ends where nothing is written for so long
  std::size_t longest = 4096;  // bytes; what is longer is no frame
  std::optional<ChecksumField> checksum{};
  RuleLine line{};

  friend bool operator==(const FrameFormat&, const FrameFormat&) = default;
};

// A number that goes on from frame to frame: the driver's from whatever it begins with, by as much as the
// tape's.
struct Counter {
  std::uint64_t modulo = 0;  // 0: as its bytes have it
  friend bool operator==(const Counter&, const Counter&) = default;
};

// What may vary.
struct Rule {
  enum class Kind : std::uint8_t { ignore, mask, regex, range, counter, frame };
  StrangerText name{};
  std::string frame{};  // only frames of that format; empty: of any
  std::string when{};   // only where this expression is found in the recorded frame; empty: everywhere
  Kind kind = Kind::ignore;
  Place place{};        // all kinds but `frame`
  Bytes mask{};         // mask: the bits that are to be as recorded, a byte for each of the place's
  std::string regex{};  // regex: what came there is this, wholly
  double least = 0;     // range: with both ends
  double most = 0;
  NumberType type = NumberType::unsigned_;  // range, counter
  ByteOrder order = ByteOrder::big;
  Counter counter{};
  // The place's length may vary, with both ends; absent: it is that of the recorded one.
  struct Length {
    std::size_t least = 0;
    std::size_t most = 0;
    friend bool operator==(const Length&, const Length&) = default;
  };
  std::optional<Length> length{};
  // frame: the whole frame may be left out; frames that fit `when` may come that the tape has not here.
  bool optional = false;
  // optional: what the tape's device says behind it, up to the driver's next write, is left out with it;
  // false: it answers nothing; nothing: not known.
  std::optional<bool> with_answer{};
  bool repeated = false;
  RuleLine line{};

  friend bool operator==(const Rule&, const Rule&) = default;
};

// A part of the request that came is copied into the recorded answer, whose checksum (that of its format) is
// computed anew.
struct ReplyTemplate {
  StrangerText name{};
  std::string frame{};  // of the request
  std::string when{};
  Place from{};
  std::string answer_frame{};  // the answer's format; empty: the first
  std::string answer{};        // only answers in which this expression is found
  Place to{};
  RuleLine line{};

  friend bool operator==(const ReplyTemplate&, const ReplyTemplate&) = default;
};

// What stands in a secret's place.
enum class FillerKind : std::uint8_t {
  like,  // digits for digits, letters for letters, what else is printable stays; other bytes: `bytes`
  digits,
  letters,
  hex,
  bytes,
  constant  // RedactRule::with, again and again
};

// What of a tape is no one's business: `porttape redact` puts a filler of the same length in its place.
struct RedactRule {
  enum class Kind : std::uint8_t { place, pattern, text, range };
  StrangerText name{};
  std::optional<Direction> direction{};  // absent: both
  Kind kind = Kind::place;
  std::string frame{};  // place: only frames of that format; empty: of any
  std::string when{};   // place: only where this expression is found in the frame
  Place place{};
  std::string pattern{};       // its first group, or all of it, wherever in the stream
  std::size_t longest = 1024;  // pattern: bytes of a match
  Bytes text{};                // text: these bytes
  std::int64_t offset = 0;     // range: of the direction's stream
  std::int64_t size = 0;
  FillerKind filler = FillerKind::like;
  Bytes with{};        // constant
  bool events = true;  // pattern, text: in the texts of header and events, too
  RuleLine line{};

  friend bool operator==(const RedactRule&, const RedactRule&) = default;
};

struct RuleSet {
  std::string file{};                 // for messages
  std::vector<FrameFormat> frames{};  // the first that fits at a place has it
  std::vector<Rule> rules{};
  std::vector<ReplyTemplate> replies{};
  std::vector<RedactRule> redactions{};

  friend bool operator==(const RuleSet& one, const RuleSet& other) {
    return one.frames == other.frames && one.rules == other.rules && one.replies == other.replies &&
           one.redactions == other.redactions;
  }
};

// A rules file that read_rules() reads as the same.
std::string to_toml(const RuleSet& rules);

}  // namespace porttape
