#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/schedule.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// Plays the tape in one run: walks the schedule, decides what is due and when a gate opens, and measures the
// driver's writes against the time they were recorded at. Knows nothing of verdicts.
//
// A *gate* is what holds a read back until the driver has written what precedes it on the tape (timing
// reactive and none): the run of write records before the read, taken as one question. Refers to its matcher
// and its clock, which must outlive it.
//
// Drive it: begin() at the driver's first open, then play() whenever something happened or wake() has come;
// at the driver's later opens one of continue_at_next_open(), restart_session() and resume(), with settle()
// before it where reads are to be lost. Nothing reads more of the tape than the budget allows; what is then
// not done or not known is asked for again when it is refilled. Not thread-safe.
class Player {
 public:
  // A write that came earlier or later than the margin allows.
  struct TimingFault {
    std::uint64_t driver_offset = 0;
    std::uint64_t tape_offset = 0;
    TapeTime at{};
    Instant real{};
    Micros error{};
  };

  Player(const ReplayConfig& config, const Engine::TapeFacts& facts, const ClockPlace& place,
         RecordSource& schedule, Budget& budget, Matcher& matcher);

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
  void become_lenient(Instant now);

  [[nodiscard]] std::optional<Instant> wake() const { return wake_; }
  // All reads are delivered and all writes came.
  [[nodiscard]] bool used_up() const { return used_up_; }
  [[nodiscard]] bool open_ahead();
  // These give nothing where that is not known before the budget is refilled.
  // Nothing but events and closes is left.
  [[nodiscard]] std::optional<bool> nothing_left();
  // Whether the walk stands at a recorded close or open with all writes before it complete.
  [[nodiscard]] std::optional<bool> at_recorded_reopen();
  // Nothing of the session is left to play: all of it came and went.
  [[nodiscard]] std::optional<bool> session_played();
  // Whether an open was passed by time so recently (`patience`), with nothing written since and something of
  // the tape left, that a close now is taken for the one before it, late.
  [[nodiscard]] std::optional<bool> just_passed_open(Instant now);

  // Writes have come that the matcher has not been given yet: no silence opens a gate meanwhile.
  void set_behind(bool behind) { behind_ = behind; }
  // Asks for play() at once.
  void wake_at(Instant now) { wake_ = now; }

  // How many of the tape's gaps the run has come to: something behind them was played.
  [[nodiscard]] std::size_t gaps_reached() const { return gaps_reached_; }
  // When the first of what the last play() delivered had been due.
  [[nodiscard]] std::optional<Instant> delivered_due() const { return delivered_due_; }
  [[nodiscard]] const Timeline& timeline() const { return timeline_; }
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
  struct Gate {
    bool pending = false;
    std::uint64_t begin = 0;  // recorded bytes before the question
    std::uint64_t end = 0;
    TapeTime at{};     // of its last write
    bool gap = false;  // a question may be missing before what comes next
  };
  struct Silence {
    Instant end{};
    bool after_writing = false;
  };
  struct Event {
    TapeTime tape{};
    Instant real{};
  };
  // What seek() is on the way to, for a driver that opened at `since`.
  struct Seek {
    enum class To : std::uint8_t { there, start, next_open, reopen_if_near } to = To::there;
    Instant since{};
  };
  struct PassedOpen {
    Instant when{};
    std::uint64_t writes_end = 0;
  };

  [[nodiscard]] bool gated() const { return config_.timing != Timing::recorded; }
  [[nodiscard]] bool checks_time() const { return config_.strictness == 2; }
  [[nodiscard]] bool silence_counts() const { return lenient_ && !behind_; }
  // Behind a gap a driver whose bytes the tape does not have would wait for its answer for ever.
  [[nodiscard]] bool in_gap() const { return !behind_ && (gate_.gap || matcher_.astray()); }

  Progress step(Turn& turn);
  Progress at_read(Turn& turn);
  Progress at_hang_up(Turn& turn);
  Progress at_write(const Turn& turn);
  Progress at_timed_write(const Turn& turn);
  Progress at_gap();
  Progress at_close(const Turn& turn);
  Progress at_open(const Turn& turn);
  Progress at_end(const Turn& turn);
  Progress wait(std::optional<Instant> until);

  bool gate_opens(Instant now, TapeTime next_at);
  bool wait_for_driver();
  [[nodiscard]] Silence next_silence(TapeTime next_at) const;
  void open_gate(TapeTime tape, Instant real, Instant not_before);
  [[nodiscard]] Instant patience_end(TapeTime next_at) const;

  void deliver(Turn& turn, Instant due);
  void begin_arrival();
  void pass();
  [[nodiscard]] bool seek_start();
  [[nodiscard]] bool seek_next_open();
  [[nodiscard]] Settled pass_on(Turn& turn, std::optional<std::uint64_t> writes);
  void start_at(TapeTime tape, Instant now);
  [[nodiscard]] Instant due(TapeTime at) const;
  [[nodiscard]] std::optional<TimingFault> compare_time(const Matcher::Completion& done, TapeTime at,
                                                        Instant expected) const;

  ReplayConfig config_;
  Engine::TapeFacts facts_;
  bool burst_;
  Budget& budget_;
  Matcher& matcher_;
  Schedule schedule_;
  ClockPlace place_;
  Timeline timeline_;

  Gate gate_;
  Instant floor_{};   // nothing is due before it: the last due time, or what opened the last gate
  Event last_event_;  // what the next write's time is measured from
  TapeTime session_start_{};
  std::optional<PassedOpen> passed_open_;
  Seek seek_;
  std::size_t gaps_reached_ = 0;
  bool behind_ = false;
  bool untimed_ = false;  // a gap is between the last event and the next
  bool lenient_ = false;
  Instant lenient_since_{};
  bool used_up_ = false;
  std::optional<Instant> wake_;
  std::optional<TimingFault> fault_;
  std::optional<Instant> delivered_due_;

  // The arrival that the read at the head belongs to.
  bool arrival_known_ = false;      // worked out for this head
  bool arrival_started_ = false;    // an arrival is going on that the next read may join
  bool arrival_continues_ = false;  // the head goes on with what was delivered before it
  TapeTime arrival_first_{};
  TapeTime arrival_last_{};
};

}  // namespace porttape
