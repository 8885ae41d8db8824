#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

#include "libport/tape/record.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// A tape made of other evidence, by a verb or a converter. It appears under its name by finish(), whole, or
// not at all, whoever is killed meanwhile. Owns its descriptors.
//
// Times stand on the tape as they are given (TapeWriter, for a line that is recorded now, moves them): they
// may be equal, and go back neither among the reads, nor among the writes, nor among the events. What is
// equal in time is read in the order of FORMAT.md, whatever the order it was given in. Empty blocks and
// blocks of up to 2^32 - 1 bytes stay what they are.
//
// After an error nothing more is taken, every further call gives it again, and nothing appears. Constant
// memory: some 600 KiB. Not thread-safe.
class NewTape {
 public:
  // The header gets what is missing of what a writer fills in (completed()). Errc::usage as
  // TapeWriter::check(), Errc::io.
  static Result<NewTape> create(const TapePaths& paths, const TapeHeader& header,
                                const TapeWriterOptions& options);
  // The same with the header line of another tape, without its newline, whose unknown keys stay.
  static Result<NewTape> create(const TapePaths& paths, std::string_view header_line,
                                const TapeWriterOptions& options);
  // On other sinks than files; finish() gives them no names.
  static Result<NewTape> on_sinks(TapeSinks sinks, const TapeHeader& header);

  NewTape(NewTape&&) noexcept;
  NewTape& operator=(NewTape&&) noexcept;
  ~NewTape();  // without finish(): nothing is left

  // Errc::usage: a time that goes back, is negative or beyond a header's 136 years. Errc::io.
  Result<void> block(Direction direction, TapeTime at, ByteView data);
  // A block whose bytes come in pieces, by add(): `length` in all, before anything else is given.
  Result<void> begin_block(Direction direction, TapeTime at, std::uint32_t length);
  Result<void> add(ByteView piece);

  // `end` is finish()'s.
  Result<void> event(TapeTime at, const Event& event);
  // Of another tape, as its line there (without a newline) has it: unknown kinds and keys stay.
  Result<void> event_line(TapeTime at, std::string_view line);
  // The same, of an event that says what held before this tape's beginning.
  Result<void> carried_line(TapeTime at, std::string_view line);

  // What a reader gives, so much later (or earlier); `end` events are left out.
  Result<void> copy(const Record& record, Micros later = Micros(0));

  // What the `end` event has digests of: all that the tape holds, or the data alone.
  enum class Vouches : std::uint8_t { all, data };
  // Brings it to the disk and gives it its name. Without a time it has no `end` event, as a tape whose
  // recorder was killed. Gives the files' names.
  Result<TapePaths> finish(std::optional<TapeTime> end, Vouches vouches = Vouches::all);

  // The latest time given so far.
  [[nodiscard]] TapeTime latest() const;

 private:
  struct Impl;
  explicit NewTape(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace porttape
