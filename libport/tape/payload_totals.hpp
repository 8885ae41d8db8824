#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "libport/base/bytes.hpp"

namespace porttape {

// What an r or w file holds in all, as the `end` event tells it.
struct PayloadTotals {
  std::uint64_t blocks = 0;
  std::uint64_t bytes = 0;                // of data
  std::optional<std::uint64_t> xxh3 = 0;  // XXH3 with 64 bits of all data; nothing where it is not told

  friend bool operator==(const PayloadTotals&, const PayloadTotals&) = default;
};

// A digest as the tape has it: 16 hexadecimal digits.
std::string digest_text(std::uint64_t xxh3);

// XXH3 with 64 bits of some bytes; another one for each seed.
std::uint64_t digest_of(ByteView data, std::uint64_t seed = 0);

// Adds up the blocks of one file as they pass: begin_block(), then its data in any pieces. About 10 ns for a
// small block.
class PayloadCounter {
 public:
  // Without a digest it costs next to nothing.
  explicit PayloadCounter(bool with_digest = true);
  PayloadCounter(PayloadCounter&&) noexcept;
  PayloadCounter& operator=(PayloadCounter&&) noexcept;
  ~PayloadCounter();

  void begin_block() { ++blocks_; }
  void add(ByteView data);
  [[nodiscard]] PayloadTotals totals() const;
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  struct Digest;
  std::uint64_t blocks_ = 0;
  std::uint64_t bytes_ = 0;
  std::unique_ptr<Digest> digest_;
};

}  // namespace porttape
