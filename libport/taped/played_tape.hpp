#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "libport/replay/roles.hpp"
#include "libport/replay/swapped_tape.hpp"
#include "libport/replay/tape_part.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {

// What of a tape is played and how it is looked at, so that all who read it see the same: the whole or one of
// its sessions, and by whom it is played.
struct PlayedAs {
  TapePart part{};
  Writer writer = Writer::driver;  // whose bytes are judged
};

// A tape as a replay reads it: what is delivered comes as reads, what is compared as writes. Owns its reader;
// one thread at a time.
class PlayedTape final : public RecordSource {
 public:
  enum class Select : std::uint8_t {
    merged,
    compared  // only the writes have bytes that count; there may be other records
  };

  // Errors as of TapeReader::open().
  static Result<std::unique_ptr<PlayedTape>> open(const TapePaths& paths, const PlayedAs& as,
                                                  Select select = Select::merged);

  Result<std::optional<Record>> next() override { return played_->next(); }
  Result<void> rewind() override { return played_->rewind(); }

  // As TapeReader has them.
  [[nodiscard]] bool has_events() const { return reader_.has_events(); }
  [[nodiscard]] std::optional<TapeHeader> header() const { return reader_.header(); }
  [[nodiscard]] std::optional<std::string> torn_tail() const { return reader_.torn_tail(); }

 private:
  PlayedTape(TapeReader reader, const PlayedAs& as, Select select);

  TapeReader reader_;
  std::optional<PartOfTape> part_;
  std::optional<SwappedTape> swapped_;
  RecordSource* played_;  // one of these
};

}  // namespace porttape
