#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <string>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/tape/live_tape.hpp"

namespace porttape {

// Keeps the tape of a line: begins it, tries again while it cannot be made, goes on with the next one at a
// rotation, ends it, and says in the log how it stands. Never waits for a disk (LiveTape); owns the tapes.
//
// Drive it: check() before the line is there, begin() at the driver's first open, then block() and note();
// finish() last. Loop thread only.
class TapeKeeper {
 public:
  struct Options {
    TapePaths tape;
    TapeHeader header;
    OnExisting on_existing = OnExisting::refuse;
    bool fail_closed = false;  // on_must_end when the tape cannot be written; else the line stays up
    Nanos retry = std::chrono::seconds(1);  // then 2 s, 4 s, … 30 s: a tape that could not be made
    std::size_t queue_bytes = std::size_t{64} << 20;
    // Makes the writer of each tape; empty: on files.
    std::function<Result<TapeWriter>(const LiveTape::Options&)> make = {};
  };

  // `on_must_end`: fail_closed, and the tape is failing; may come more than once.
  TapeKeeper(const PortContext& context, Options options, std::function<void()> on_must_end);
  ~TapeKeeper();
  TapeKeeper(const TapeKeeper&) = delete;
  TapeKeeper& operator=(const TapeKeeper&) = delete;

  // Whether the tape can be made. Makes nothing. Errc::usage.
  [[nodiscard]] Result<void> check() const;

  // The tape begins; its zero is `zero`.
  void begin(Instant zero);
  [[nodiscard]] bool begun() const { return begun_; }

  void block(Direction direction, Instant at, ByteView data);
  // An event, in its place among the blocks.
  void note(Instant at, Event event);
  // The driver opened or closed the line: events, and what a tape begins with that could not be made before.
  void opened(Instant at);
  void closed(Instant at);

  // Ends the tape and begins the next one, whose zero is `now`. Nothing to do before begin().
  void rotate(Instant now);

  // Ends the tape. `done` comes once, from within or later, at the latest after kEndLimit: with whether
  // everything that passed is on the tapes.
  static constexpr std::chrono::seconds kEndLimit{10};
  void finish(Instant now, std::function<void(bool complete)> done);

 private:
  struct Ending;

  void start();
  void end_current(Instant now);
  void on_news();
  void look_at_current();
  void look_at_ending();
  void not_made(const LiveTape::Status& status);
  void tell_failure(const std::string& failure, std::uint64_t lost);
  void tell_sync_error(const LiveTape::Status& status, bool& told);
  void watch_disk();
  void must_end();
  void give_up_ending();
  void complete_if_over();
  [[nodiscard]] TapeTime tape_time(Instant at) const;

  PortContext context_;
  Options options_;
  unsigned first_number_ = 1;  // of the names that the next tape may take
  std::function<void()> on_must_end_;
  std::unique_ptr<LiveTape> tape_;  // null before begin(), and while it cannot be made
  std::list<Ending> ending_;        // tapes that are being finished
  Instant zero_{};
  std::optional<Instant> open_since_;
  bool begun_ = false;
  bool incomplete_ = false;
  // Of the current tape.
  std::string id_;
  bool made_told_ = false;
  bool slow_told_ = false;
  bool sync_told_ = false;
  bool silence_told_ = false;
  bool failing_ = false;
  bool failure_told_ = false;
  Instant next_telling_{};
  std::uint64_t missed_bytes_ = 0;  // while it could not be made
  std::optional<Instant> missed_since_;
  std::string missed_why_;
  Nanos retry_{};
  Timer retry_timer_;
  Timer watch_timer_;
  Timer end_timer_;
  std::function<void(bool)> on_done_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
