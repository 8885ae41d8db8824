#pragma once

#include <functional>
#include <optional>
#include <string>

#include "libport/tape/line_state.hpp"
#include "libport/tape/new_tape.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {

// Told how many bytes of the tapes were read so far. May be empty.
using TapeProgress = std::function<void(std::uint64_t bytes)>;

// A record's bytes in its file.
std::uint64_t bytes_in_file(const Record& record);

// The header of a tape that is made of another, which may have none: a new id, no tape before it, and its
// origin.
TapeHeader made_of(const std::optional<TapeHeader>& source, const std::string& name, std::string by);
// Its line, with what this version does not know of the other one's. Both without a newline.
std::string made_line(std::string_view source_line, const TapeHeader& header);

// Writes a part of a tape as a tape of its own. What held on the line before stands at its beginning, in
// events with the key `carried`: so it replays. A NewTape: it appears by finish(), or not at all.
class PartWriter {
 public:
  struct Options {
    TapePaths to;
    TapeWriterOptions writer;
    std::string by;        // the verb
    std::string name;      // of the source, without its folder
    TapeTime from{};       // where the part begins on the source
    bool rebased = false;  // and is its time 0
    std::optional<PreviousTape> previous;
  };

  // `before`: what held there.
  static Result<PartWriter> begin(const TapeReader& source, const LineState& before, const Options& options);

  Result<void> copy(const Record& record);
  // `end`, on the source's time. Without one it has no `end` event.
  Result<TapePaths> finish(std::optional<TapeTime> end);

  [[nodiscard]] const std::string& id() const { return id_; }
  [[nodiscard]] TapeTime latest() const { return tape_.latest() - later_; }  // on the source's time

 private:
  PartWriter(NewTape tape, std::string id, Micros later)
      : tape_(std::move(tape)), id_(std::move(id)), later_(later) {}

  NewTape tape_;
  std::string id_;
  Micros later_;
};

}  // namespace porttape
