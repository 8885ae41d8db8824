#pragma once

#include <cstdint>

#include "libport/base/bytes.hpp"

namespace porttape {

// How recorded answers follow what the driver wrote: a sequence number copied, a checksum mended. One for
// each that plays a tape; where there is none, answers are played as they stand on the tape and nothing is
// asked.
//
// Drive it: begin() at the run's begin; asked() with each stretch that a comparison
// has used, in turn; answer() for each recorded read (or piece of one) when it is delivered, in turn; rest()
// when the next thing on the tape is none, and once the device's line or sending ends.
class Replies {
 public:
  // Bytes that were taken for each other; either may be empty. How they are cut is chance.
  struct Asked {
    std::uint64_t offset = 0;  // of the first recorded one, in the tape's stream of writes
    ByteView recorded;
    ByteView came;
  };
  // A recorded read that is due.
  struct Read {
    ByteView bytes;            // not yet delivered
    std::uint64_t offset = 0;  // of the first of them in the tape's stream of reads
    std::uint64_t writes = 0;  // recorded bytes of writes before it: its request ends there
  };

  virtual ~Replies() = default;

  virtual void begin() = 0;
  virtual void asked(const Asked& asked) = 0;
  // What is delivered in its place: longer, shorter or nothing. An end of it may be kept for the next
  // answer() or rest(), where its place in the answer is not known yet.
  [[nodiscard]] virtual Bytes answer(const Read& read) = 0;
  [[nodiscard]] virtual Bytes rest() = 0;
  // Whether rest() has something.
  [[nodiscard]] virtual bool keeps() const = 0;
};

}  // namespace porttape
