#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "libport/tape/tape_diff.hpp"

namespace porttape {

// A difference of two tapes with its turns; null: that tape has none. Valid until the next is read.
struct ShownDifference {
  TapeDifference what;
  const Turn* one = nullptr;
  const Turn* other = nullptr;
};

// Reads the turns of differences again, in order. Owns its readers; refers to the differences.
class DifferenceReader {
 public:
  struct Options {
    bool events = true;                                              // as they were compared
    std::uint64_t most = std::numeric_limits<std::uint64_t>::max();  // that will be asked for
  };

  static Result<DifferenceReader> open(const TapePaths& one, const TapePaths& other,
                                       std::span<const TapeDifference> differences, const Options& options);

  // Called once for each at most. Errc::io: a tape has become shorter meanwhile.
  Result<ShownDifference> next();

 private:
  // Gives turns by their numbers, ascending.
  class Lookup {
   public:
    static Result<Lookup> open(const TapePaths& tape, bool events);
    // Valid until the next call.
    Result<const Turn*> at(std::uint32_t number);

   private:
    Lookup(TapeReader reader, bool events);
    std::unique_ptr<TapeReader> tape_;
    std::unique_ptr<TurnReader> turns_;
    const Turn* turn_ = nullptr;
  };
  struct CrossingTurn {
    std::uint32_t number = 0;
    Turn turn;
  };

  DifferenceReader(Lookup one, Lookup other, std::span<const TapeDifference> differences)
      : one_(std::move(one)), other_(std::move(other)), differences_(differences) {}
  Result<void> find_crossings(const TapePaths& one, bool events);
  const Turn* crossing_turn(std::uint32_t number, const Turn& other);

  Lookup one_;
  Lookup other_;
  std::span<const TapeDifference> differences_;
  std::vector<CrossingTurn> crossings_;  // of the first tape, without their bytes
  Turn given_;                           // one of them, with its bytes
};

}  // namespace porttape
