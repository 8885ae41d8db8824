#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <sys/types.h>

#include "libport/tape/record.hpp"
#include "libport/tape/tape_batch.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_sink.hpp"

namespace porttape {

// What happens where one of the new tape's files exists already.
enum class OnExisting : std::uint8_t {
  refuse,    // an error
  next,      // the first free one of NAME.log, NAME.2.log, NAME.3.log, … is taken
  overwrite  // replaced, but never a tape that is being written, a symlink, or what is no regular file
};

struct TapeWriterOptions {
  OnExisting on_existing = OnExisting::refuse;
  unsigned first_number = 1;    // next: the first name to be tried
  bool sync = true;             // fdatasync at the end
  mode_t kept_from_others = 0;  // permissions that the new files lack, see source_mode.hpp
};

// Where the bytes of a new tape go; all three are there.
struct TapeSinks {
  std::unique_ptr<TapeSink> read;
  std::unique_ptr<TapeSink> write;
  std::unique_ptr<TapeSink> events;
};

// Writes a tape: one writev a block, so that a killed process loses at most the block it was in. Owns its
// descriptors.
//
// check() at program start, create() when the driver first opens the port, then read_block(), write_block()
// and event() in the order in which things happen, finish() at the end (also done
// by the destructor, where errors cannot be told; what is given later is lost). Times are relative to the
// tape's zero; a negative one counts as 0, and one that is not later than the last block's becomes that one's
// plus 1 µs, so the order across the three files is exact.
//
// A failing disk never throws and never stops the line: the block that did not fit is taken back whole, what
// is lost is counted, and once writing works again a `gap` event tells how much is missing and why. failing()
// says so meanwhile. (Under a file size limit, RLIMIT_FSIZE, the program must ignore SIGXFSZ for that.)
//
// A *batch* collects what is given, for a disk on which each call may take long; commit() writes it, each
// file in one go. Of a file that takes only a part the whole blocks that fit are kept.
//
// Not thread-safe. LiveTape keeps one without ever holding up its caller.
class TapeWriter {
 public:
  // Whether a tape can be made there: a folder that is there and writable, and nothing in the way, see
  // OnExisting. Makes nothing. Errc::usage with what to do.
  static Result<void> check(const TapePaths& paths, const TapeWriterOptions& options);

  // Makes the three files (0640 less the umask, each new: O_EXCL, each locked until finish()) and writes the
  // header line. Leaves nothing behind on an error. Errc::usage as check(), Errc::io.
  static Result<TapeWriter> create(const TapePaths& paths, const TapeHeader& header,
                                   const TapeWriterOptions& options);

  // Writes to other sinks than files. Errc::io: the header line could not be written.
  static Result<TapeWriter> on_sinks(TapeSinks sinks, const TapeHeader& header,
                                     const TapeWriterOptions& options);

  TapeWriter(TapeWriter&&) noexcept;
  TapeWriter& operator=(TapeWriter&&) noexcept;
  ~TapeWriter();

  void read_block(TapeTime at, ByteView data);   // device → driver; empty data writes nothing
  void write_block(TapeTime at, ByteView data);  // driver → device
  void block(Direction direction, TapeTime at, ByteView data) {
    direction == Direction::read ? read_block(at, data) : write_block(at, data);
  }
  void event(TapeTime at, Event event);  // a gap that tells no `from` begins at its own time

  // An event of another tape, as its line there (without a newline) has it; no gap.
  void event_line(TapeTime at, std::string_view line);

  void begin_batch();
  void commit(const RunBoth& run_both = {});

  // Bytes for the tape that were lost before they came here: counted, and told by a gap event like those that
  // a disk did not take.
  void lose(TapeTime at, std::uint64_t bytes, std::string_view why);

  // Brings what was written to the disk; each may be called from any thread at any time, also after finish().
  [[nodiscard]] std::array<TapeSink::Sync, 3> syncers();

  // Writes the `end` event, syncs and closes. Errc::io if anything is missing from the tape. Later calls give
  // the same.
  Result<void> finish(TapeTime at, const RunBoth& run_both = {});

  [[nodiscard]] const TapePaths& paths() const;       // the files that create() has made
  [[nodiscard]] const std::string& id() const;        // of the tape
  [[nodiscard]] bool failing() const;                 // the last block could not be written
  [[nodiscard]] std::string failure() const;          // why, as a line for a person; empty when not failing
  [[nodiscard]] std::uint64_t bytes_lost() const;     // in all, since create()
  [[nodiscard]] std::uint64_t bytes_written() const;  // payload of both directions

 private:
  struct Impl;
  explicit TapeWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace porttape
