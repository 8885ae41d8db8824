#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/tape/live_tape.hpp"
#include "libport/taped/ending_tapes.hpp"
#include "libport/taped/line_observer.hpp"
#include "libport/taped/tape_group.hpp"
#include "libport/taped/tape_news.hpp"

namespace porttape {

// Keeps the tape of a line: begins it, tries again while it cannot be made, goes on with the next one at a
// rotation, ends it, and says in the log how it stands. Never waits for a disk (LiveTape); owns the tapes.
//
// The tape's zero is the first open, its own or that of its group. Its files come into being then; those that
// replace other ones only when the line is up, so that a device that cannot be opened costs nothing.
class TapeKeeper final : public LineObserver {
 public:
  struct Options {
    TapePaths tape;
    TapeHeader header;
    OnExisting on_existing = OnExisting::refuse;
    bool fail_closed = false;  // on_must_end when the tape cannot be written; else the line stays up
    Nanos retry = std::chrono::seconds(1);  // then 2 s, 4 s, … 30 s: a tape that could not be made
    std::size_t queue_bytes = std::size_t{64} << 20;
    // It is one of these, of this connection, whose zero and names it has; null: a tape by itself.
    std::shared_ptr<TapeGroup> group = {};
    unsigned connection = 1;
    // Makes the writer of each tape; empty: on files.
    std::function<Result<TapeWriter>(const LiveTape::Options&)> make = {};
    // By which the disk's silence is measured, as LiveTape::Options has it.
    const Clock* disk_clock = nullptr;
    // What is known of the recorded device only when it is open; asked for each tape.
    std::function<void(TapeHeader&)> describe = {};
    std::function<void(const TapePaths&)> on_ended = {};  // each tape that was made, at its end
  };

  // `on_must_end`: fail_closed, and the tape is failing; may come more than once.
  TapeKeeper(const PortContext& context, Options options, std::function<void()> on_must_end);
  ~TapeKeeper() override;
  TapeKeeper(const TapeKeeper&) = delete;
  TapeKeeper& operator=(const TapeKeeper&) = delete;

  // Whether the tape can be made. Makes nothing. Errc::usage.
  [[nodiscard]] Result<void> check() const override;
  void opened(Instant at) override;
  void came_up(Instant at) override;
  void closed(Instant at) override;
  void block(Direction direction, Instant at, ByteView data) override;
  void note(Instant at, const Event& event) override;
  Result<bool> request(Instant at, const RecorderRequest& what) override;
  [[nodiscard]] std::optional<RecordingStatus> recording() const override;
  void finish(Instant now, std::function<void(bool complete)> done) override;
  void give_up() override;

 private:
  void begin();
  void rotate(Instant now);
  Result<void> note_asked(Instant at, const Event& event);
  [[nodiscard]] Result<void> can_write() const;
  void start();
  void take_part(const TapeGroup::Part& part);
  void note_held_settings();
  void end_current(Instant now);
  void tell_missed();
  void on_news();
  void not_made(const LiveTape::Status& status);
  void watch_disk();
  void must_end();
  [[nodiscard]] TapeTime tape_time(Instant at) const;

  PortContext context_;
  Options options_;
  unsigned first_number_ = 1;  // that the next tape may take; one more a tape, since making one may last
  std::function<void()> on_must_end_;
  std::unique_ptr<LiveTape> tape_;  // null before begin(), and while it cannot be made
  EndingTapes ending_;              // those before it
  std::optional<Instant> first_open_;
  Instant zero_{};
  unsigned part_ = 0;  // of the group
  std::optional<Instant> open_since_;
  // The settings that hold, which each tape begins with.
  struct HeldSettings {
    Instant since{};
    event::Settings what;
  };
  std::optional<HeldSettings> device_settings_;
  std::optional<HeldSettings> driver_settings_;  // in this session
  bool open_ = false;                            // by a driver
  bool begun_ = false;                           // the first tape
  bool incomplete_ = false;
  bool finished_ = false;
  std::string id_;  // of the current tape
  TapeNews news_;
  std::uint64_t missed_bytes_ = 0;  // while there is none, since it could not be made
  std::optional<Instant> missed_since_;
  std::string missed_why_;
  Nanos retry_{};
  Timer retry_timer_;
  Timer watch_timer_;
};

}  // namespace porttape
