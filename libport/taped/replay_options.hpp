#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/base/time.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/replay_reports.hpp"

namespace porttape {

// What a ReplayPort plays, and how.
struct ReplayOptions {
  TapePaths tape;
  ReplayConfig config;
  bool once = false;
  bool start_paused = false;
  std::uint64_t session = 0;  // only this one of the tape is played, 1-based; 0: all of them
  std::string report_file = {};
  std::string junit_file = {};
  std::shared_ptr<const Expectation> expectation = {};  // what of a write may vary; null: nothing
  // That other ports play by too, with its rate instead of the one in `config`; null: the context's, or one
  // of its own. On a shared one tapes begin as their zeros lie, and one without a zero with the first.
  std::shared_ptr<ReplayClock> clock = {};
  // The tape is that of this connection, one of several, and the report file has the runs of all.
  std::optional<unsigned> connection = {};
  std::shared_ptr<ReplayReports::Group> group = {};
  std::function<void(const RunReport&)> on_report = {};  // each run's, or empty
  // After a mismatch that fails the run the line hangs up a moment later, so that the report knows more.
  bool looks_on = false;
  // The program ends soon, and has no other ports: where the tape has no reopen, opens are looked for in
  // the first 30 ms instead of being told by inotify, which takes the kernel some 15 ms to close.
  bool brief = false;
  // finish() comes because the run is over, as when its command has ended, and not because somebody asks
  // for an end: it waits until the whole tape is counted.
  bool ends_with_run = false;
  // Where it plays the driver: how long the device may be silent, beyond the time it took on the tape, or
  // its line take nothing; none: for ever.
  std::optional<Nanos> silence = {};
  bool waits_for_line = false;  // to come up, however long
  bool keeps_line = false;  // as the device's port has it: not as it was when the recorded driver opened it
};

}  // namespace porttape
