#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/tape/new_tape.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

struct ImportOptions {
  bool swapped = false;                  // reads are writes and writes are reads
  Micros lead{};                         // silence before what comes first
  std::optional<unsigned> bytes_at{};    // bit/s (8N1): the time that what has no time of its own takes
  std::optional<std::string> device{};   // which of several devices
  std::optional<std::string> with{};     // a second file of the evidence
  std::optional<std::string> dialect{};  // the file of a text log's dialect
};

struct ImportedTape {
  TapePaths paths;
  std::uint64_t blocks = 0;
  std::uint64_t events = 0;
  TapeTime end{};
  std::vector<std::string> guesses;   // what is on the tape and was not told
  std::vector<std::string> problems;  // of the evidence; the first ones
  std::uint64_t problem_count = 0;
};

// The tape that an importer makes: takes what the evidence tells in its order, and keeps the rules of a tape.
// A time that goes back becomes the one before, which is a problem that is told; a missing one is guessed. It
// appears by finish(), whole, or not at all. After an error every further call gives it again.
class ImportTape {
 public:
  // On files, or (for tests) on sinks.
  ImportTape(TapePaths to, TapeWriterOptions writer, ImportOptions options, std::string source);
  ImportTape(TapeSinks to, ImportOptions options, std::string source);

  // Before the first record, where the evidence tells it; without a newline.
  Result<void> header(const TapeHeader& header);
  Result<void> header_line(std::string_view line);
  // Without a header: when the tape's zero was, before the first record; RFC 3339.
  void wall_of_zero(std::string wall) { wall_of_zero_ = std::move(wall); }

  // What comes later stands later, where a tape would put equal times in another order (events, then writes,
  // then reads): by a microsecond. For evidence whose order tells more than its times; false: not of what
  // follows.
  void keep_order(bool keep = true) { keeps_order_ = keep; }

  // What is given from now on stands in that line of the evidence (from 1), for problems with it. 0: it has
  // no lines.
  void at_line(std::uint64_t line) { line_ = line; }

  // Without a time: a microsecond after what was before, so that the order stays, or, with bytes_at, when it
  // is sent.
  Result<void> block(Direction direction, std::optional<TapeTime> at, ByteView data);
  // A block whose bytes come in pieces, by add(): `length` in all, before anything else is given.
  Result<void> begin_block(Direction direction, TapeTime at, std::uint32_t length);
  Result<void> add(ByteView piece);
  Result<void> event(TapeTime at, const Event& event);
  Result<void> event_line(TapeTime at, std::string_view line);

  // What was not told and is so on the tape: a mark at the tape's end, once for each text.
  void guessed(std::string text);
  // What is wrong with the evidence and does not stop the import.
  void problem(std::string text);
  // The same, of a line of it: one problem for each text, with its lines.
  void problem_of_line(std::uint64_t line, std::string_view text);

  // Nothing: the tape has no `end`, as that of a recorder that was killed.
  Result<ImportedTape> finish(std::optional<TapeTime> end);
  // At what came last.
  Result<ImportedTape> finish() { return finish(latest()); }

  [[nodiscard]] TapeTime latest() const { return latest_; }  // without the lead
  [[nodiscard]] const ImportOptions& options() const { return options_; }
  [[nodiscard]] bool empty() const { return done_.blocks == 0 && done_.events == 0; }

  // The evidence is of its form for sure, also where it has no records.
  void sure() { sure_ = true; }
  [[nodiscard]] bool is_sure() const { return sure_; }

 private:
  Result<void> begin();
  Result<void> checked(Result<void> result);
  [[nodiscard]] Direction way(Direction told) const;
  // When it is on the tape: in order, and behind the lead.
  TapeTime placed(TapeTime at, RecordKind kind);

  TapePaths to_;
  std::optional<TapeSinks> sinks_;
  TapeWriterOptions writer_;
  ImportOptions options_;
  std::string source_;
  std::string header_line_;
  std::optional<TapeHeader> header_;
  std::string wall_of_zero_;
  std::optional<NewTape> tape_;
  std::optional<Error> failed_;
  TapeTime latest_{};
  TapeTime latest_told_{};  // by the evidence
  std::uint64_t line_ = 0;
  std::uint64_t went_back_ = 0;  // of what has no line
  TapeTime first_back_{};
  bool keeps_order_ = false;
  bool sure_ = false;
  RecordKind last_kind_ = RecordKind::event;
  struct ProblemOfLines {
    std::string text;
    std::vector<std::uint64_t> first_lines;
    std::uint64_t count = 0;
    std::uint64_t last_line = 0;
  };
  std::vector<ProblemOfLines> of_lines_;
  ImportedTape done_;
};

}  // namespace porttape
