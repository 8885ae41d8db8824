#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_fault.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/excerpt.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/roles.hpp"
#include "libport/replay/settings_check.hpp"
#include "libport/replay/think_times.hpp"

namespace porttape {

enum class Verdict : std::uint8_t {
  pass,
  data_mismatch,
  settings_mismatch,
  timing_mismatch,
  incomplete,
  extra
};

enum class MismatchKind : std::uint8_t { data, timing, extra };

// Where and how what the driver wrote differs from the tape. Offsets count the bytes the driver has written
// in this run.
struct Mismatch {
  MismatchKind kind = MismatchKind::data;
  std::uint64_t offset = 0;  // of the first differing byte; timing: of the write's last byte
  TapeTime tape{};           // recorded time of the write it was compared with
  Micros real{};             // since the driver's first open of the run
  Bytes expected;            // from the offset on; a few bytes, fewer at the tape's end
  Bytes got;                 // timing: both are the write that came too early or late
  Bytes before;              // what was right just before the offset, for context
  // Of the write on the tape: its bytes in `before`, and those from the offset on, as far as known.
  std::uint64_t block_before = 0;
  std::uint64_t block_after = 0;
  std::uint64_t write = 0;         // 1-based: which of the driver's writes; 0: not known
  std::uint64_t write_offset = 0;  // and where in it
  std::uint64_t exchange =
      0;                // 1-based: which exchange (a run of writes and its answer) of the tape it belongs to
  Micros error{};       // timing: + late, - early
  Micros allowed{};     // timing: so much of it would have been right
  std::string hint;     // "already consumed at …", "comes later at …", or empty
  std::string why;      // what an expectation says is wrong there; empty: the bytes are not the recorded ones
  std::string went_on;  // on-mismatch=resync: where the tape goes on, for a person; or empty
  std::uint64_t tape_offset = 0;  // where in the tape's own write stream; hints count there too
  Micros own_late{};              // timing: how late our own last delivery before it was
  // From the offset on: `got` and what was written after it, as far as that was kept.
  Bytes came;
  bool answered = false;        // what came was answered as on the tape, and what it wrote then is in `came`
  std::uint64_t delivered = 0;  // bytes of the tape's reads that had been delivered by then

  static constexpr std::size_t kMostCame = 1024;
  static constexpr std::size_t kMostShown = 32;  // of `expected`, `got` and `before`
};

// Something that overlapped the run and may have had its part in the verdict (contract section 6).
struct Doubt {
  enum class Kind : std::uint8_t { gap, stall, answer, unchecked, unread, refused, flushed };
  Kind kind = Kind::stall;
  std::string text;  // for a person

  friend bool operator==(const Doubt&, const Doubt&) = default;
};

// A stretch of a tape in which something is missing.
struct TapeGap {
  TapeTime from{};
  TapeTime to{};            // where the tape goes on
  std::uint64_t bytes = 0;  // of both directions; 0: unknown, or no bytes
  StrangerText why;
};

// What was done to the line on purpose in a run, by a wrapper of its port.
struct FaultsReport {
  static constexpr std::size_t kMostListed = 1000;
  std::string plan;
  std::uint64_t seed = 0;
  std::uint64_t made = 0;
  std::map<StrangerText, std::uint64_t> kinds = {};  // how many of each
  std::vector<LineFault> list = {};                  // the first ones

  void add(const LineFault& fault);
};

// What a whole tape holds, in bytes.
struct TapeTotals {
  std::uint64_t reads = 0;
  std::uint64_t writes = 0;
  // What of that is before the part's start.
  std::uint64_t reads_before = 0;
  std::uint64_t writes_before = 0;

  friend bool operator==(const TapeTotals&, const TapeTotals&) = default;
};

// match=lookup: which of the tape's requests were asked for. Requests that are answered in turn count as one.
struct LookupReport {
  struct Request {
    TapeTime at{};             // the first of its kind
    std::uint64_t offset = 0;  // in the tape's stream of writes
    std::uint64_t size = 0;
    Bytes bytes;  // a few

    friend bool operator==(const Request&, const Request&) = default;
  };
  static constexpr std::size_t kMostListed = 64;

  std::uint64_t requests = 0;        // that differ, on the tape
  std::uint64_t asked = 0;           // those of them that were asked for
  std::uint64_t answered = 0;        // how often any was
  std::uint64_t unknown = 0;         // how often what the driver wrote was none
  std::uint64_t undelivered = 0;     // bytes of the answers that the driver did not wait for
  std::vector<Request> never_asked;  // the first of them

  friend bool operator==(const LookupReport&, const LookupReport&) = default;
};

// What of the tape a run was to play, how often, and what a user did to it meanwhile.
struct PlaybackReport {
  TapeTime start{};
  std::optional<TapeTime> end = {};
  bool preroll = false;
  std::optional<Micros> max_gap = {};
  std::uint64_t loops = 1;                    // that were begun
  std::uint64_t loops_complete = 0;           // all writes of theirs came
  std::optional<std::uint64_t> loops_of = 1;  // nothing: for ever
  TapeTotals prerolled{};                     // of the tape, before the start
  std::uint64_t pauses = 0;
  Nanos paused{};  // in all
  std::uint64_t steps = 0;
  std::uint64_t seeks = 0;
  std::uint64_t rates = 0;  // changes

  // It was steered by hand.
  [[nodiscard]] bool steered() const { return pauses + steps + seeks + rates > 0; }
};

// The verdict on one run with what led to it. The report file and `porttape test` print it.
struct RunReport {
  Verdict verdict = Verdict::pass;
  Writer writer = Writer::driver;  // whose bytes are judged; `driver` below stands for it
  std::string tape;          // filled in by the port that owns the engine, as are `when` and `nobody_came`
  std::string when;          // RFC 3339: the driver's first open
  bool nobody_came = false;  // no driver has opened the port: there was no run
  bool again = false;        // the latest run's once more, with doubts that came after it
  std::optional<unsigned> connection;  // the tape is that of one of several: which
  int strictness = 1;
  Timing timing = Timing::reactive;
  double rate = 1.0;
  std::string chunks;      // `bytes`, or `random:SEED`, the option that cuts so again; empty: nothing was cut
  bool ruled = false;      // there are rules of what may vary
  bool rewritten = false;  // and of how answers follow from it
  bool leaves_out = false;  // and of what the driver may leave out, with its answer
  Nanos duration{};
  std::uint64_t to_driver_bytes = 0;
  std::optional<std::uint64_t> to_driver_of;  // nothing: the tape was not counted
  std::uint64_t from_driver_bytes = 0;
  // What the device did besides sending, in its place: how often, by the event's kind on the tape.
  std::map<std::string, std::uint64_t, std::less<>> told;
  std::uint64_t from_driver_matched = 0;
  std::optional<std::uint64_t> from_driver_of;
  std::optional<Mismatch> mismatch;  // the first one
  std::uint64_t mismatches = 0;      // all of them (on-mismatch warn goes on)
  double timer_late_p50_us = 0;      // how late our own deliveries were
  double timer_late_p99_us = 0;
  double timer_late_max_us = 0;
  std::vector<Doubt> doubts;
  std::optional<FaultsReport> faults;  // none: none were planned
  std::optional<int> command_exit;     // `porttape test`
  std::optional<int> process_exit;     // what the program ends with, where more than the verdict decides
  // For a person, or empty: why it ends so, where the verdict does not say it; how the command ended.
  std::string outcome;
  std::string command_end;
  std::optional<std::string>
      trouble;  // the tape could not be read on: damage, I/O; the exit status is then 1

  // The driver's opens that made a session of the run, and what the tape (or the part that is played) has.
  std::uint64_t sessions_made = 1;
  std::uint64_t sessions_of = 1;
  std::optional<std::uint64_t> session;  // only this one of the tape is played
  SettingsReport settings;               // of the part of the tape that the run came to
  bool settings_checked = false;         // they are part of the verdict
  // When the driver had ended its sending on the tape, and in this run did not.
  std::optional<TapeTime> missed_half_close;

  std::optional<LookupReport> lookup;
  PlaybackReport playback;

  // The verdict stands only if the tape has no writes beyond this offset, which was not known when the run
  // ended: add_totals() settles it.
  std::optional<std::uint64_t> undecided_from;

  // The first recorded bytes the driver never sent (a few of them), where in the tape's write stream, and
  // when recorded.
  Bytes next_expected;
  std::uint64_t next_expected_block = 0;  // so many of them are of one write of the tape, as far as known
  Bytes next_expected_before;             // what of that write the driver did send
  std::uint64_t next_expected_offset = 0;
  TapeTime next_expected_tape{};

  bool closed = false;                       // the run ended by the driver's close
  std::uint64_t delivered = 0;               // bytes of the tape's reads, at the end of the run
  std::optional<std::uint64_t> left_unread;  // of what was delivered, at the driver's close, where known
  std::uint64_t left_unread_before = 0;      // the same, of the run's closes before, as far as known
  // At one of these closes the line did not tell how much was left: it never does (a socket), or it could not
  // that time.
  bool left_untold = false;
  bool left_unseen = false;
  // The driver dropped what had come to it more often than the tape's: whether it had read that is not known.
  bool left_flushed = false;
  // Of the tape's reads, what no driver could read: it came with nobody there, was dropped by a flush of the
  // driver's own, or answered what a rule let be left out.
  std::uint64_t reads_excused = 0;
  std::uint64_t output_flushes = 0;             // of the tape's driver, each behind other writes
  std::uint64_t input_flushes = 0;              // of the tape's driver
  bool must_read = false;                       // what was not read is part of the verdict
  std::optional<std::uint64_t> unread_of = {};  // so many bytes could have been read, where that is known
  std::optional<std::uint64_t> unread = {};  // of what was recorded as read, where judge_reading() found any
  Micros idle{};                             // from the last byte of either direction to the run's end
  bool hung = false;                         // `porttape test`: it slept, or ran too long, and was ended

  std::optional<ThinkTimes> think_times;  // timing reactive and none

  // What a user can type, or empty: `porttape test` says it.
  std::string repeat_line;
  std::string step_line;  // with a debugger

  // The tape around what is wrong, and what follows from it: diagnose() fills the latter.
  std::shared_ptr<const TapeExcerpt> excerpt;
  Diagnosis diagnosis;
};

std::string_view to_string(Verdict verdict);

// Says what the tape holds, and settles an undecided verdict by it.
void add_totals(RunReport& report, const TapeTotals& totals);
// The tape could not be counted: an undecided verdict is `incomplete`, and the report's trouble says `why`.
void give_up_totals(RunReport& report, std::string_view why);
// Judges what the driver did not read of what was recorded as read, once the totals are known or given up: a
// doubt, or the verdict where the driver took nothing of a tape that only speaks, or must read all.
void judge_reading(RunReport& report);
// Whether it found the verdict, which then has no other cause.
bool is_incomplete_by_unread(const RunReport& report);
// The tape is not what was recorded, as `why` tells: nothing passes by it.
void damage(RunReport& report, std::string_view why);
int exit_status_of(const RunReport& report);

// The report of contract section 6, one JSON object, newline at the end.
// `runs` (JSON), where it is given, is its key of that name.
std::string to_json(const RunReport& report, std::string_view runs = {});
// What a list of runs has of each: one JSON object.
std::string run_json(const RunReport& report);

// The verdict for a person: one line, and for a mismatch the lines that show it. `color` adds ANSI colours.
std::string to_text(const RunReport& report, bool color = false);

// What was not as usual, in lines; empty: nothing.
std::string to_text(const PlaybackReport& played);

// The mismatch alone, as to_text() shows it; for the log of a running daemon.
std::string to_text(const Mismatch& mismatch, Writer writer = Writer::driver, bool color = false);

}  // namespace porttape
