#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_event.hpp"
#include "libport/replay/answer_source.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/replay/line_step.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/report.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What the engine wants done, in this order. Values only; the engine performs nothing itself.
struct ReplayActions {
  // Hand it to the driver, in one write unless the line keeps datagrams.
  Bytes deliver;
  // Where each (piece of an) arrival ends in `deliver`; the last is its size.
  std::vector<std::size_t> block_ends;
  // What the device does besides, each behind so many bytes of `deliver`.
  struct Told {
    std::size_t behind = 0;
    LineEvent event;
  };
  std::vector<Told> events;
  // Where the tape plays the driver: what it does with its line then.
  std::optional<LineStep> line_step;
  // New ones, to tell. At most 16 between two calls; the report counts all.
  std::vector<Mismatch> mismatches;
  // Let the driver see the end of what the device sends; it may still write. Nothing where its line has no
  // half-close.
  bool end_sending = false;
  // Make the driver see the line break (on-mismatch fail, at-end hangup, a recorded hang-up), once it has
  // read what was delivered.
  bool hang_up = false;
  // A run is over; the next on_open begins another. Comes with hang_up and exit, and with no delivery of the
  // next run.
  std::optional<RunReport> run_ended;
  // At-end exit: the program should end, once the driver has read what was delivered.
  bool exit = false;

  [[nodiscard]] bool empty() const {
    return deliver.empty() && events.empty() && !line_step && mismatches.empty() && !end_sending &&
           !hang_up && !run_ended && !exit;
  }
};

// The device a tape plays, or the driver (ReplayConfig::writer): its sources are SwappedTapes then, and what
// is said here of the driver is said of the device. README.md beside this file has the rules. Pure: no I/O of
// its own (the tape comes through the two sources), reads no clock, starts no thread, logs nothing; time is
// an argument and never goes back. Memory is bounded whatever the tape's size. Not thread-safe.
//
// Drive it: on_open when the driver opens (the first opener only), on_write for what it writes, on_close when
// the last one closes, finish at the end of the program; after each of these and of set_blocked, and when
// next_deadline() has come, call advance(now) until next_deadline() is not due. `schedule` is the whole tape
// in merged order, `writes` the w file alone; both must outlive the engine and be its own. An error of a
// source ends the run with RunReport::trouble; the next on_open tries again from the start.
//
// No call reads more of the tape than a Budget holds: what is left over, also of what it was told, goes on at
// the next advance(), and next_deadline() is due until then.
class Engine {
 public:
  struct TapeFacts {
    // Has an events file: chunks=auto means `recorded`, else `burst`.
    bool stamped_at_arrival = false;
    // `open` events on the whole tape: a close with one ahead does not end the run. With 0, only an open that
    // the walk already stands at is seen to be ahead.
    std::uint64_t opens = 0;
    // When each recorded hang-up was: what the driver writes beyond the writes recorded before it, until it
    // closes, went to nobody then, and is not compared.
    std::vector<TapeTime> hang_ups{};
    std::vector<TapeGap> gaps{};
    // When the session began in which the part's start lies; nothing: the start is in none.
    std::optional<TapeTime> preroll_from{};
    // The settings of the device's line when the tape begins, as far as known.
    SeenSettings line{};
    // What the tape holds, if known; else the reports say nothing of it (see add_totals).
    std::optional<TapeTotals> totals{};
  };

  // What it is given from outside; all must outlive it.
  struct Parts {
    const Expectation* expectation = nullptr;  // what of a write may vary; null: nothing
    // Played by, with its rate, together with the other engines that have it; null: a clock of its own, that
    // each session sets anew.
    ReplayClock* clock = nullptr;
    Micros tape_begin{};  // of this tape, by the clock's tape time
    // The whole tape once more and its reads, of the engine's own: needed with match=lookup, and with
    // on-mismatch=resync, which without them is as warn.
    RecordSource* index = nullptr;
    AnswerSource* answers = nullptr;
    // The driver's line can end in one direction; else its recorded half-closes are passed by.
    bool half_closes = false;
  };

  Engine(const ReplayConfig& config, const TapeFacts& facts, RecordSource& schedule, RecordSource& writes)
      : Engine(config, facts, schedule, writes, Parts{}) {}
  Engine(const ReplayConfig& config, const TapeFacts& facts, RecordSource& schedule, RecordSource& writes,
         const Parts& parts);
  ~Engine();
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  void on_open(Instant now);
  void on_write(Instant now, ByteView data);
  // It writes no more in this session and still reads (a connection closed in one direction): the device ends
  // its own when all that the tape has for it without further writes was delivered.
  void on_writing_ended(Instant now);
  // What it did on its line besides. A flush throws away what is due and was not delivered yet; what is due
  // later still comes. Of settings and signals, what the tape has and it never makes is in the run's report.
  // Other events change nothing.
  void on_event(Instant now, const LineEvent& event);
  // Its line shows signals: the device's are played, and its own are gates and checked. Before on_open().
  void show_signals(bool on);
  void on_close(Instant now);
  // Where the tape plays the driver: the device has ended the line. Where the tape has no such end there, the
  // run is over. A line that the driver opens anew (LineStep) is told by on_open() once it is there.
  void on_line_ended(Instant now);
  // Whether the tape has the device's end, or that of all it was to say, where the walk stands; nothing while
  // that is not known.
  [[nodiscard]] std::optional<bool> line_may_end();

  // Steers what is played, by hand; each also where no driver has the port open, but for seek() and step().
  // While it stands the line is up and what the driver writes is compared, but nothing is delivered, and
  // nothing is late: the clock stands, also that of the other engines which have it.
  void stand(Instant now, bool on);
  // While it stands: so many exchanges come at once, each what the device says up to the driver's next write,
  // or of a device that speaks on unasked, a second of the tape.
  void step(Instant now, std::uint64_t exchanges);
  // The session goes on there: what is between is neither expected nor missing.
  void seek(Instant now, TapeTime to);
  // `rate` > 0. From now on.
  void set_rate(Instant now, double rate);
  struct Playing {
    bool stands = false;
    double rate = 1;
    // Of the run that goes on.
    std::optional<TapeTime> position{};
    std::uint64_t loop = 0;
  };
  [[nodiscard]] Playing playing(Instant now);

  // When advance() should be called next; nothing while only the driver can move things on.
  [[nodiscard]] std::optional<Instant> next_deadline() const;

  // Does everything due at `now`, at most `max_bytes` of delivery a call (the rest stays due: next_deadline()
  // <= now).
  [[nodiscard]] ReplayActions advance(Instant now, std::size_t max_bytes = 65536);

  // The program or the command ends: ends the run, if one has begun; its report comes from advance(). Nothing
  // else is to be told to the engine then.
  void finish(Instant now);
  // Whether finish() is done with.
  [[nodiscard]] bool finished() const;
  // Ends the run at once, whatever is still to be read, and forgets what the engine was told and has not
  // looked at yet; its report comes from advance().
  void give_up(Instant now);

  // Bytes it was told of by on_write and has not looked at yet; they grow with a driver that writes on.
  [[nodiscard]] std::size_t backlog() const;

  // The first recorded bytes that the driver has not written in this run; nothing when it wrote all, or while
  // no run goes on, or the tape was not read so far.
  struct Unsent {
    std::uint64_t offset = 0;  // in the tape's stream
    TapeTime at{};
    Bytes bytes;  // a few of them
    // When it would have come after what was played last: at the recorded pace, and at the replay's.
    Instant due{};
  };
  [[nodiscard]] std::optional<Unsent> first_unsent() const;

  // A piece that is due waits for the driver to read the one before (chunks=bytes and random), at most to
  // next_deadline(): on_taken() when it has read all that was delivered.
  [[nodiscard]] bool holds_piece() const;
  void on_taken(Instant now);

  // The line could not take bytes at `now` / can again: lateness is not measured in between, deliveries wait.
  void set_blocked(bool blocked);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace porttape
