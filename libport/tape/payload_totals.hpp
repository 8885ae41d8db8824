#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// What an r or w file holds in all, as the `end` event tells it.
struct PayloadTotals {
  std::uint64_t blocks = 0;
  std::uint64_t bytes = 0;                     // of data
  std::optional<std::uint64_t> xxh3 = 0;       // XXH3 with 64 bits of all data; nothing where it is not told
  std::optional<std::uint64_t> xxh3_all = {};  // of all blocks, their headers too

  friend bool operator==(const PayloadTotals&, const PayloadTotals&) = default;
};

// A digest as the tape has it: 16 hexadecimal digits.
std::string digest_text(std::uint64_t xxh3);

// XXH3 with 64 bits of some bytes; another one for each seed.
std::uint64_t digest_of(ByteView data, std::uint64_t seed = 0);

// The same of bytes that come in pieces. A copy goes on by itself.
class StreamDigest {
 public:
  StreamDigest();
  StreamDigest(const StreamDigest& other);
  StreamDigest& operator=(const StreamDigest& other);
  StreamDigest(StreamDigest&&) noexcept;
  StreamDigest& operator=(StreamDigest&&) noexcept;
  ~StreamDigest();

  void add(ByteView data);
  [[nodiscard]] std::uint64_t value() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Adds up the blocks of one file as they pass: begin_block(), then its data in any pieces. About 30 ns for a
// small block.
class PayloadCounter {
 public:
  // Without digests it costs next to nothing.
  explicit PayloadCounter(bool with_digests = true);

  // `at` is from 0 to kMaxBlockTimeUs.
  void begin_block(TapeTime at, std::uint32_t length);
  void add(ByteView data);
  [[nodiscard]] PayloadTotals totals() const;
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  struct Digests {
    StreamDigest payload;
    StreamDigest all;
  };
  std::uint64_t blocks_ = 0;
  std::uint64_t bytes_ = 0;
  std::optional<Digests> digests_;
};

}  // namespace porttape
