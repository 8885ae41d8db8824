#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/replay/device_line.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/give_up.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/tape_part.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// What a replay knows of a tape beforehand, by its events alone.
struct TapeFacts {
  Engine::TapeFacts facts;  // of the part that is played
  std::optional<TapeZero> zero;
  TapePart part;
  DeviceLine line;
  TapeTime last{};                 // event of the part
  std::optional<Error> flaw = {};  // a file that is not what the tape's end tells of it: it is not played
  std::optional<bool> ended =
      {};                   // whether the tape has its end; nothing: no events, or the part ends before
  bool end_passed = false;  // and not so because something stands behind the `end` event
  std::vector<std::string> stray = {};  // notes: what its files have behind what its end tells of
  std::string missing = {};  // a file that is not there, where the tape's end does not tell what it held
  bool checkable = false;    // its end has digests, by which check_tape() finds more than a size shows
};

// What of a tape is wanted.
struct PlayedPart {
  std::uint64_t session = 0;  // 0: all
  TapeTime start{};
  std::optional<TapeTime> end = {};
};

// What of that is a doubt of each run.
std::vector<Doubt> doubts_of(const TapeFacts& tape);

// Reads the events file through, which is small. Errc::usage where the tape has not so many sessions.
Result<TapeFacts> tape_facts(const TapePaths& tape, const PlayedPart& played);

// Reads all of a tape, whatever part is played. Nothing: it was given up. An error that came with `whole`
// tells that the tape is not what its end tells of; else it could not be read on.
struct TapeCheck {
  Result<void> found;
  bool whole = false;  // all of it was read
};
std::optional<TapeCheck> check_tape(const TapePaths& tape, const GiveUp& give_up = {});

// What the tape's device had: by its events, or by the options that an older recorder opened it with.
std::optional<LineSettings> own_settings(const DeviceLine& line, const std::optional<TapeHeader>& header);

}  // namespace porttape
