#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/replay_config.hpp"

namespace porttape {

// Cuts what comes to the driver into pieces that are arrivals of their own (chunks=bytes and random), and
// holds each back until the driver has read the one before: what lies unread together is read together. A
// value; without cuts it does nothing.
class Pieces {
 public:
  static constexpr Nanos kLongestWait = std::chrono::milliseconds(10);  // for the one before to be read
  static constexpr Nanos kMostLate = std::chrono::milliseconds(100);  // none is held longer after it was due

  // `seed`: of random cuts.
  Pieces(Chunks chunks, std::uint32_t seed) : chunks_(chunks), seed_(seed) {}

  [[nodiscard]] bool cut() const { return chunks_ == Chunks::bytes || chunks_ == Chunks::random; }

  // Nothing is unread.
  void begin(Instant now) { taken(now); }
  void delivered(Instant now) {
    if (cut()) unread_since_ = now;
  }
  // The driver has read all that was delivered.
  void taken(Instant now) {
    unread_since_.reset();
    taken_at_ = now;
  }

  // How long the piece is that begins at `offset` of the tape's reads, where `most` bytes are at hand. Where
  // the cuts are hangs on seed and offset alone; `again` tells apart the times that one place is played.
  [[nodiscard]] std::size_t size(std::uint64_t offset, std::size_t most, std::uint64_t again = 0) const {
    if (chunks_ == Chunks::bytes) return std::min<std::size_t>(most, 1);
    if (chunks_ != Chunks::random) return most;
    std::size_t size = 0;
    while (size < most && (size == 0 || !cut_before(offset + size, again))) ++size;
    return size;
  }

  // When what is due at `due` may go at the latest; it may at once when the driver has read.
  [[nodiscard]] Instant free_at(Instant due) const {
    if (!unread_since_) return std::max(due, taken_at_);
    return std::max(due, std::min(*unread_since_ + kLongestWait, due + kMostLate));
  }
  // Nothing: it is not held back.
  [[nodiscard]] std::optional<Instant> held_until(Instant now, Instant due) const {
    const Instant free = unread_since_ ? free_at(due) : now;
    return free > now ? std::optional(free) : std::nullopt;
  }

 private:
  // Stretches of 64 bytes are cut finely or coarsely, from single bytes to some 32.
  [[nodiscard]] bool cut_before(std::uint64_t offset, std::uint64_t again) const {
    const std::uint64_t fineness = mixed(offset / 64, 2 * again) % 6;
    return mixed(offset, 2 * again + 1) % (std::uint64_t{1} << fineness) == 0;
  }
  // SplitMix64 of the seed and two numbers.
  [[nodiscard]] std::uint64_t mixed(std::uint64_t number, std::uint64_t stream) const {
    std::uint64_t z =
        (std::uint64_t{seed_} << 32U) + stream * 0xD1B54A32D192ED03U + number * 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }

  Chunks chunks_;
  std::uint32_t seed_;
  std::optional<Instant> unread_since_;
  Instant taken_at_{};
};

}  // namespace porttape
