#include "libport/replay/hint.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>

#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kReach = std::uint64_t{16} << 20;
constexpr std::size_t kLongestNeedle = 16;

// Finds a short needle in a stream that is fed byte by byte (Knuth, Morris, Pratt).
class Needle {
 public:
  explicit Needle(ByteView needle) : size_(std::min(needle.size(), kLongestNeedle)) {
    std::copy_n(needle.begin(), size_, bytes_.begin());
    for (std::size_t i = 1, matched = 0; i < size_; ++i) {
      while (matched > 0 && bytes_[i] != bytes_[matched]) matched = border_[matched - 1];
      if (bytes_[i] == bytes_[matched]) ++matched;
      border_[i] = matched;
    }
  }

  // Whether the needle ends with this byte.
  bool feed(Byte byte) {
    if (matched_ == size_) matched_ = border_[size_ - 1];
    while (matched_ > 0 && byte != bytes_[matched_]) matched_ = border_[matched_ - 1];
    if (byte == bytes_[matched_]) ++matched_;
    return matched_ == size_;
  }

  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  std::size_t size_;
  std::size_t matched_ = 0;
  std::array<Byte, kLongestNeedle> bytes_{};
  std::array<std::size_t, kLongestNeedle> border_{};
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
