#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/arrivals.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/gate.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/pace.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/schedule.hpp"
#include "libport/replay/tape_sessions.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// Plays the tape in one run: walks the schedule, delivers what is due and no gate holds back, and measures
// the driver's writes against the time they were recorded at. Knows nothing of verdicts.
//
// Drive it: begin() at the driver's first open, then play() whenever something happened or wake() has come;
// at the driver's later opens one of continue_at_next_open(), restart_session() and resume(), with settle()
// before it where reads are to be lost. Nothing reads more of the tape than the budget allows; what is then
// not done or not known is asked for again when it is refilled. Refers to its matcher, budget and clock,
// which must outlive it. Not thread-safe.
class Player {
 public:
  // A write that came earlier or later than the margin allows.
  struct TimingFault {
    std::uint64_t driver_offset = 0;
    std::uint64_t tape_offset = 0;
    TapeTime at{};
    Instant real{};
    Micros error{};
    Bytes bytes;  // of the write; a few
  };

  // `half_closes`: the driver's line can end in one direction.
  Player(const ReplayConfig& config, const Engine::TapeFacts& facts, const ClockPlace& place,
         bool half_closes, RecordSource& schedule, Budget& budget, Matcher& matcher);
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  // At the driver's first open; seek() follows.
  void begin(Instant now);
  // Passes everything up to the tape's next open and goes on from there; seek() follows.
  void continue_at_next_open(Instant now);
  // The driver closed and opened again with nothing exchanged: the session begins anew, nothing is lost.
  void restart_session(Instant now);
  // Goes on where it was, on the same clock, or at a recorded reopen if it stands there; seek() follows.
  void resume(Instant now);
  // Goes to where the session is to play from; call until it is true.
  [[nodiscard]] bool seek();

  // Delivers what is due into `out` and moves on, until something is to be waited for (wake() then says until
  // when) or a write's timing is at fault. Call again after a fault.
  std::optional<TimingFault> play(Instant now, std::size_t max_bytes, bool blocked, ReplayActions& out);

  // Of settle() and judge(): call again until it is done, also after a fault.
  struct Settled {
    bool done = false;
    std::optional<TimingFault> fault{};
  };
  // The driver has closed and the clock runs on: passes, undelivered, what was due by `now` and no gate holds
  // back, up to the next recorded close or open.
  [[nodiscard]] Settled settle(Instant now);
  // The driver throws away what is due and unread: no answer whose time has come is delivered any more.
  [[nodiscard]] Settled flush(Instant now);
  // The driver has closed, or the run ends: goes on to the writes that it has made ahead of the walk, so that
  // their times are held against the tape's. Answers on the way count as delivered when due.
  [[nodiscard]] Settled judge(Instant now);

  // timing=recorded: how the write just completed compares with its recorded time.
  std::optional<TimingFault> check_recorded(const Matcher::Step& step, Instant now) const;

  // From the run's first divergence on (and always at strictness 0) gates also open by quiet and patience.
  void become_lenient(Instant now) { gate_.become_lenient(now); }

  [[nodiscard]] std::optional<Instant> wake() const { return wake_; }
  // The driver writes no more in this session since then; nothing: it may.
  void set_writing_ended(std::optional<Instant> since);
  // When the first half-close was recorded that the driver was to make in this run and did not.
  [[nodiscard]] const std::optional<TapeTime>& missed_half_close() const { return missed_half_close_; }

  // All reads are delivered and all writes came.
  [[nodiscard]] bool used_up() const { return used_up_; }

  // Where the walk stands among the tape's sessions.
  [[nodiscard]] TapeSessions& sessions() { return sessions_; }

  // Writes have come that the matcher has not been given yet: no silence opens a gate meanwhile.
  void set_behind(bool behind) { gate_.set_behind(behind); }
  // Asks for play() at once.
  void wake_at(Instant now) { wake_ = now; }

  // How many of the tape's gaps the run has come to: something behind them was played.
  [[nodiscard]] std::size_t gaps_reached() const { return gaps_reached_; }
  // When the first of what the last play() delivered had been due.
  [[nodiscard]] std::optional<Instant> delivered_due() const { return delivered_due_; }
  [[nodiscard]] const Timeline& timeline() const { return pace_.timeline(); }
  [[nodiscard]] Schedule& schedule() { return schedule_; }

 private:
  enum class Mode : std::uint8_t { deliver, drop_all, drop_due, flush };
  enum class Progress : std::uint8_t { passed, waits, fault };
  struct Turn {
    Instant now{};
    Mode mode = Mode::deliver;
    bool blocked = false;
    std::size_t room = 0;
    ReplayActions* out = nullptr;
  };
  // What seek() is on the way to, for a driver that opened at `since`.
  struct Seek {
    enum class To : std::uint8_t { there, start, next_open, reopen_if_near } to = To::there;
    Instant since{};
  };

  [[nodiscard]] bool gated() const { return config_.timing != Timing::recorded; }
  [[nodiscard]] bool checks_time() const { return config_.strictness == 2; }

  Progress step(Turn& turn);
  Progress at_read(Turn& turn);
  Progress at_device_end(Turn& turn, bool ReplayActions::*what);
  Progress at_half_close(Turn& turn);
  Progress at_driver_end(const Turn& turn);
  Progress at_write(const Turn& turn);
  Progress at_timed_write(const Turn& turn);
  Progress at_gap();
  Progress at_close(const Turn& turn);
  Progress at_open(const Turn& turn);
  Progress at_end(const Turn& turn);
  Progress wait(std::optional<Instant> until);

  bool gate_opens(Instant now, TapeTime next_at);
  void deliver(Turn& turn, Instant due);
  [[nodiscard]] Settled pass_on(Turn& turn, std::optional<std::uint64_t> writes);
  void start_at(TapeTime tape, Instant now);
  [[nodiscard]] std::optional<TimingFault> compare_time(const Matcher::Completion& done, TapeTime at,
                                                        Instant expected, ByteView bytes) const;

  ReplayConfig config_;
  bool half_closes_;
  Budget& budget_;
  Matcher& matcher_;
  Schedule schedule_;
  Arrivals arrivals_;
  Pace pace_;
  Gate gate_;
  TapeSessions sessions_;

  TapeTime session_start_{};
  Seek seek_;
  std::size_t gaps_reached_ = 0;
  std::optional<Instant> writing_ended_;
  std::optional<TapeTime> missed_half_close_;
  bool untimed_ = false;  // a gap is between the last event and the next
  bool used_up_ = false;
  std::optional<Instant> wake_;
  std::optional<TimingFault> fault_;
  std::optional<Instant> delivered_due_;
};

}  // namespace porttape
