#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "libport/tape/block.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// Where the bytes of a tape come from; null is a file that is not there.
struct TapeSources {
  std::unique_ptr<ByteSource> read;
  std::unique_ptr<ByteSource> write;
  std::unique_ptr<ByteSource> events;

  // The files that exist. Errc::usage: unreadable, a folder, …, or neither an r nor a w file there.
  static Result<TapeSources> open(const TapePaths& paths);
  // The same by another way to open a file; null: it is not there.
  using Open = std::function<Result<std::unique_ptr<ByteSource>>(const std::filesystem::path&)>;
  static Result<TapeSources> open(const TapePaths& paths, const Open& open_file);
  // As detect_layout(). Where the events file begins with a header, what keeps the r and w files from being
  // read is damage: Errc::damaged_tape.
  [[nodiscard]] Result<Layout> layout() const;
};

// Reads a tape in the exact order across its files, in constant memory, whatever its size. Owns its
// descriptors.
//
// Drive it by next() until it gives nothing; rewind() starts again. On equal stamps the order is: events,
// then the write, then the read. A missing w or e file counts as empty (a missing r file too, if there is a w
// file). Not thread-safe; several readers may read one tape, also while it is being written (a torn tail is
// then just the end so far). Memory: at most 256 KiB for each of the r and w file and 64 KiB for the e file.
class TapeReader final : public RecordSource {
 public:
  enum class Select {
    merged,       // reads, writes and events
    reads_only,   // only RecordKind::read
    writes_only,  // only RecordKind::write
    events_only   // all that is neither read nor write
  };

  struct Options {
    Select select = Select::merged;
    bool grows = false;  // is being written: the order is exact also for what comes while it is looked at
    // Damage of the events file ends that file alone: its error follows the last block.
    bool events_may_fail = false;
    // Having given all that is merged, it fails with Errc::damaged_tape where that is not what the tape's
    // `end` tells of. Not where the tape was being written when it was opened.
    bool checks_end = true;
  };

  // Errors: Errc::usage (unreadable, a folder, …), Errc::not_a_tape, Errc::damaged_tape. Damage further on is
  // found by next().
  static Result<TapeReader> open(const TapePaths& paths, Select select = Select::merged) {
    return open(paths, Options{.select = select});
  }
  static Result<TapeReader> open(const TapePaths& paths, const Options& options);

  static Result<TapeReader> from_sources(TapeSources sources, Select select = Select::merged) {
    return from_sources(std::move(sources), Options{.select = select});
  }
  static Result<TapeReader> from_sources(TapeSources sources, const Options& options);

  TapeReader(TapeReader&&) noexcept;
  TapeReader& operator=(TapeReader&&) noexcept;
  ~TapeReader() override;

  Result<std::optional<Record>> next() override;
  // Whether all files have been read to their ends: what next() gives as an error is then of the whole tape.
  [[nodiscard]] bool came_to_end() const;
  Result<void> rewind() override;
  // When next() has given nothing: it goes on with what has been written since.
  void read_on();

  // Whether the tape has an events file, that is: was made by porttape and is stamped at arrival.
  [[nodiscard]] bool has_events() const;

  // What the events file says about the tape, if it is there and has a whole header line (read with
  // Select::merged only).
  [[nodiscard]] std::optional<TapeHeader> header() const;

  // That line as it stands there, without its newline; empty where there is none.
  [[nodiscard]] std::string header_line() const;

  // A torn tail seen so far, as a note for a person; known for sure once next() has given nothing.
  [[nodiscard]] std::optional<std::string> torn_tail() const;

  // Why a tape without an events file, whose `end` would tell, cannot be taken for whole: it has a torn tail,
  // or lacks its r or its w file. As a note for a person; a tape that is made of it gets no `end`. Known for
  // sure once next() has given nothing.
  [[nodiscard]] std::optional<std::string> half() const;

 private:
  struct Impl;
  explicit TapeReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace porttape
