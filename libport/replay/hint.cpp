#include "libport/replay/hint.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>

#include "libport/replay/search_pattern.hpp"
#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kReach = std::uint64_t{16} << 20;
constexpr std::size_t kLongestNeedle = 16;

// Finds a short needle in a stream that is fed byte by byte.
class Needle {
 public:
  explicit Needle(ByteView needle) {
    for (const Byte byte : needle.first(std::min(needle.size(), kLongestNeedle))) pattern_.append(byte);
  }

  // Whether the needle ends with this byte.
  bool feed(Byte byte) {
    matched_ = pattern_.matched_after(matched_, byte);
    return matched_ == size();
  }

  [[nodiscard]] std::size_t size() const { return pattern_.size(); }

 private:
  SearchPattern pattern_;
  std::size_t matched_ = 0;
};

struct Place {
  std::uint64_t offset = 0;
  TapeTime at{};
};

struct Found {
  std::optional<Place> before;  // the last one
  std::optional<Place> after;   // the first one
};

// Looks through one piece of the stream; false when there is no need to go on.
bool look_through(const Record& piece, std::uint64_t offset, Needle& needle,
                  std::array<TapeTime, kLongestNeedle>& times, Found& found) {
  std::uint64_t position = piece.stream_offset;
  if (position + piece.data.size() + kReach + kLongestNeedle < offset) return true;
  for (const Byte byte : piece.data) {
    times[position % kLongestNeedle] = piece.at;
    ++position;
    if (position + kReach < offset || !needle.feed(byte)) continue;
    const std::uint64_t start = position - needle.size();
    if (position <= offset) {
      found.before = Place{start, times[start % kLongestNeedle]};
    } else if (start > offset) {
      found.after = Place{start, times[start % kLongestNeedle]};
      return false;
    }
  }
  return position < offset || position - offset < kReach;
}

void append(std::string& text, const char* words, const Place& place) {
  if (!text.empty()) text += "; ";
  text += words;
  text += " at offset " + std::to_string(place.offset) + " (tape " + seconds_text(to_us(place.at)) + ")";
}

}  // namespace

std::optional<std::string> find_hint(RecordSource& writes, std::uint64_t offset, ByteView got,
                                     const GiveUp& give_up) {
  if (got.empty() || !writes.rewind()) return std::string();
  Needle needle(got);
  Found found;
  std::array<TapeTime, kLongestNeedle> times{};
  for (unsigned looked = 1;; ++looked) {
    if (looked % kRecordsBetweenLooks == 0 && give_up && give_up()) return std::nullopt;
    const auto record = writes.next();
    if (!record || !*record) break;
    if ((*record)->kind == RecordKind::write && !look_through(**record, offset, needle, times, found)) break;
  }
  std::string text;
  if (found.before) append(text, "already consumed", *found.before);
  if (found.after) append(text, "comes later", *found.after);
  return text;
}

}  // namespace porttape
