#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/replay/device_line.hpp"
#include "libport/replay/engine.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/taped/played_tape.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/tape_answers.hpp"

namespace porttape {

// A tape that is to be played, opened and checked as far as that takes no time: what an engine reads of it,
// and what else is known of it beforehand. It must outlive the engine.
struct ReplaySources {
  std::unique_ptr<PlayedTape> schedule;
  std::unique_ptr<PlayedTape> writes;
  std::unique_ptr<PlayedTape> index;  // with match=lookup or on-mismatch=resync, as `answers`
  std::unique_ptr<TapeAnswers> answers;
  PlayedAs as;
  Engine::TapeFacts facts;
  std::optional<TapeHeader> header;
  std::optional<TapeZero> zero;
  DeviceLine line;
  std::optional<LineSettings> settings;  // the device's own
  std::optional<bool> ended;             // see TapeFacts
  std::vector<Doubt> doubts;             // known beforehand, see doubts_of_run()
  std::optional<TapeTime> length;        // of what is played, if known
  bool datagrams = false;                // each of its blocks was one
  bool unchecked = false;                // check_tape() is still to be asked

  // Errc::usage where the options ask for what the tape has not; Errc::damaged_tape where it is not what its
  // end tells of it.
  static Result<ReplaySources> open(const ReplayOptions& options);

  // Of a run that ends now and that somebody came to.
  [[nodiscard]] std::vector<Doubt> doubts_of_run() const;
};

}  // namespace porttape
