#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/rules/redact_book.hpp"

namespace porttape {

// So many bytes of a stream were replaced.
struct Redaction {
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
  int rule = kFollows;

  static constexpr int kFollows =
      -1;  // a frame's checksum or length, which follows from what else was replaced
  friend bool operator==(const Redaction&, const Redaction&) = default;
};

// Replaces the secrets in one stream of bytes, however that comes in pieces. Where secrets overlap, the
// earlier rule's filler stands; no byte of either is left.
//
// Drive it by add() (and pause(), where frames end by it), then finish(); after each take() what is ready.
// Memory: some 500 KiB and a few times the longest frame. Refers to the book.
class RedactStream {
 public:
  enum class Of : std::uint8_t { reads, writes, text };  // a text: no frames, and ASCII alone is put in

  RedactStream(const RedactBook& book, Of of);

  // Errc::usage: a match is longer than its rule's `longest`, so that not all of the secret may be known.
  Result<void> add(ByteView bytes);
  // Nothing came for so long that a frame has ended, or the other side spoke.
  Result<void> pause();
  Result<void> finish();

  struct Ready {
    Bytes bytes;
    std::vector<Redaction> redactions;  // by place
  };
  // What is final since the last call.
  Ready take();

  // Frames that hold something replaced and whose checksum was wrong before: it stays.
  [[nodiscard]] std::uint64_t wrong_checksums() const { return wrong_checksums_; }

 private:
  struct Frame {
    std::size_t begin = 0;
    std::size_t end = 0;
    int format = -1;
  };

  [[nodiscard]] bool concerns(const RedactRule& rule) const;
  Result<void> work(bool frame_ended, bool all_ended);
  void cut_frames(bool ended);
  Result<void> search(std::size_t rule, bool ended);
  void search_range(std::size_t rule, bool ended);
  void replace(std::size_t rule, FrameSpan secret);
  void mend(const Frame& frame);
  void settle();
  void forget();

  const RedactBook& book_;
  Of of_;
  std::uint64_t base_ = 0;             // where bytes_ begins in the stream
  Bytes bytes_;                        // as they came, from a byte before what is not searched
  Bytes out_;                          // with what was replaced
  std::vector<std::uint16_t> owner_;   // of each byte: the rule that has replaced it, from 1; 0: none
  std::size_t worked_ = 0;             // bytes that were there at the last work()
  std::size_t framed_ = 0;             // up to here frames are cut
  std::vector<std::size_t> searched_;  // each rule's
  std::size_t settled_ = 0;
  std::size_t taken_ = 0;
  std::deque<Frame> frames_;  // not settled
  std::vector<Redaction> found_;
  std::uint64_t wrong_checksums_ = 0;
};

}  // namespace porttape
