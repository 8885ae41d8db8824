#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/line/waiting_events.hpp"
#include "libport/replay/arrivals.hpp"
#include "libport/replay/driver_line.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/gate.hpp"
#include "libport/replay/hand_step.hpp"
#include "libport/replay/handshake.hpp"
#include "libport/replay/loops.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/pace.hpp"
#include "libport/replay/pieces.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/schedule.hpp"
#include "libport/replay/signal_steps.hpp"
#include "libport/replay/tape_sessions.hpp"
#include "libport/replay/think_times.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// Plays the tape in one run: walks the schedule, delivers what is due and no gate holds back, and measures
// the driver's writes against the time they were recorded at. Knows nothing of verdicts.
//
// Drive it: begin() at the driver's first open, then play() whenever something happened or wake() has come;
// at the driver's later opens one of continue_at_next_open(), restart_session() and resume(), with settle()
// before it where reads are to be lost. Nothing reads more of the tape than the budget allows; what is then
// not done or not known is asked for again when it is refilled. Refers to its matcher, budget, clock, check
// of settings and pieces (which are of the line, whoever else speaks on it); they must outlive it. Not
// thread-safe.
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
         bool half_closes, RecordSource& schedule, Budget& budget, Matcher& matcher, SettingsCheck& settings,
         Pieces& pieces);
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  // What makes answers follow; null: nothing. Must outlive it.
  void set_replies(Replies* replies) { replies_ = replies; }
  // The driver's line shows signals: its own are gates like writes. Before begin().
  void show_signals(bool on) { shows_signals_ = on; }
  // The driver has changed one, or its settings.
  void driver_did(Instant now, const LineEvent& event) {
    const auto* signal = std::get_if<LineSignal>(&event);
    if (signal == nullptr) return;
    if (shows_signals_) signals_.made(now, *signal);
    wake_ = now;
  }

  // At the driver's first open; seek() follows.
  void begin(Instant now);
  // The session goes on from `to`, whatever is between; seek() follows.
  void jump(TapeTime to, Instant now);
  // The next loop begins, though this one's time is not over; seek() follows.
  void begin_next_loop(Instant now);
  // Passes everything up to the tape's next open and goes on from there; seek() follows.
  void continue_at_next_open(Instant now);
  // The driver closed and opened again with nothing exchanged: the session begins anew, nothing is lost.
  void restart_session(Instant now);
  // Goes on where it was, on the same clock, or at a recorded reopen if it stands there; seek() follows.
  void resume(Instant now);
  // Goes to where the session is to play from; call until it is true. play() does so too.
  [[nodiscard]] bool seek();

  // The clock stands: nothing is delivered, but for exchanges by hand, whose times are passed over.
  void hold(bool held) { by_hand_.hold(held); }
  void step(std::uint64_t exchanges) { by_hand_.add(exchanges); }
  void set_rate(double rate, Instant now) { pace_.set_rate(rate, now); }
  // Where on the tape it is.
  [[nodiscard]] TapeTime position(Instant now) const;

  [[nodiscard]] const Loops& loops() const { return loops_; }
  // How often the walk has gone elsewhere: to its start, to another loop, behind the preroll, by hand.
  [[nodiscard]] std::uint64_t jumps() const { return jumps_; }
  // What of a preroll there was on the tape, in bytes.
  [[nodiscard]] const Schedule::Totals& prerolled() const { return prerolled_; }

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
  // The driver's line was hung up: nothing comes on it before it is opened anew.
  void set_hung_up(bool hung_up) {
    hung_up_ = hung_up;
    if (hung_up) late_events_.clear();
  }
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
  // A piece that is due waits for the driver to read what was delivered.
  [[nodiscard]] bool holds_piece() const { return holds_piece_; }
  // A part of a recorded read was delivered, and the rest was not.
  [[nodiscard]] bool inside_read() const { return schedule_.inside_read(); }
  // Asks for play() at once.
  void wake_at(Instant now) { wake_ = now; }

  // Where the tape plays the driver: the line that it opened anew is there; the device has ended the line.
  void line_opened(Instant now);
  void line_ended(Instant now);
  [[nodiscard]] const DriverLine& driver_line() const { return driver_line_; }
  // When `at` comes after what was played last, however fast the replay is.
  [[nodiscard]] Instant due_after_last(TapeTime at) const { return pace_.unhurried_after_last(at); }

  // Passes the events that the walk stands at: they wait for nobody. False: as far as the budget goes.
  [[nodiscard]] bool pass_events();

  // How many of the tape's gaps the run has come to: something behind them was played.
  [[nodiscard]] std::size_t gaps_reached() const { return std::max(gaps_reached_, most_gaps_); }
  // When the first of what the last play() delivered had been due.
  [[nodiscard]] std::optional<Instant> delivered_due() const { return delivered_due_; }
  // Of this run.
  [[nodiscard]] const ThinkTimer& think_times() const { return think_times_; }
  // How many answers came to writes that were left out, of which nobody said whether they come then.
  [[nodiscard]] std::uint64_t doubtful_answers() const { return doubtful_answers_; }
  // How much of the tape's reads the walk has delivered or passed.
  [[nodiscard]] std::uint64_t reads_delivered() { return schedule_.reads_taken(); }
  // What of them no driver could read, see RunReport.
  [[nodiscard]] std::uint64_t reads_excused() const { return reads_excused_; }
  // Where the tape is at `now`, by the session's timeline alone.
  [[nodiscard]] TapeTime tape(Instant now) const { return pace_.tape(now); }
  [[nodiscard]] Schedule& schedule() { return schedule_; }

 private:
  enum class Mode : std::uint8_t { deliver, drop_all, drop_due, flush };
  using LeftOut = Expectation::LeftOut;
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
    enum class To : std::uint8_t { there, time, next_open, reopen_if_near } to = To::there;
    Instant since{};
    TapeTime target{};  // time
    bool jumps = true;  // time: no session of the clock's begins there
  };

  [[nodiscard]] bool gated() const { return config_.timing != Timing::recorded || handshake_; }
  [[nodiscard]] bool checks_time() const { return config_.strictness == 2 && !handshake_; }
  [[nodiscard]] bool comes_by_hand(const Turn& turn) const {
    return by_hand_.under_way() && turn.mode == Mode::deliver;
  }
  // Whether a read that is due at `when` is dropped by now; by a flush not where the clock stands.
  [[nodiscard]] bool passes_over(const Turn& turn, Instant when) const {
    const bool holds = turn.mode == Mode::flush && pace_.clock().stands();
    return holds ? when < turn.now : when <= turn.now;
  }
  // Whether what is due at `when` is to be waited for; by hand nothing is.
  [[nodiscard]] bool early(Turn& turn, Instant when) const;
  void end_step(Turn& turn);
  void answered_by_hand(const Turn& turn, TapeTime at);

  Progress step(Turn& turn);
  Progress at_read(Turn& turn);
  Progress at_device_end(Turn& turn, bool ReplayActions::*what);
  Progress at_half_close(Turn& turn);
  Progress at_driver_end(Turn& turn, bool seen);
  Progress at_event(Turn& turn);
  Progress at_device_event(Turn& turn, const LineEvent& event);
  Progress at_driver_signal(Turn& turn, const LineSignal& signal);
  Progress at_own_step(const Turn& turn,
                       DriverLine::Answer (DriverLine::*way)(Instant, std::optional<LineStep>&));
  Progress at_write(Turn& turn);
  Progress at_timed_write(const Turn& turn);
  Progress at_gap();
  Progress at_close(Turn& turn);
  Progress at_open(Turn& turn);
  Progress at_end(Turn& turn);
  Progress at_loop_end(Turn& turn);
  Progress end_preroll(const Turn& turn);
  Progress wait(std::optional<Instant> until);

  bool gate_opens(Instant now, TapeTime next_at);
  Progress pass_read();
  Progress excuse_read();
  bool answer_is_left_out(const Turn& turn);
  [[nodiscard]] ByteView next_piece();
  void deliver(Turn& turn, ByteView piece, Instant due);
  bool finish_answer(Turn& turn);
  void append(ReplayActions& out, ByteView bytes, bool goes_on);
  [[nodiscard]] Replies::Read read_of(ByteView bytes);
  void take_request_time();
  [[nodiscard]] Settled pass_on(Turn& turn, std::optional<std::uint64_t> writes);
  enum class Begins : std::uint8_t { session, elsewhere };
  void tell_signals();
  void start_at(TapeTime tape, Instant now, Begins begins = Begins::session);
  void pop();
  void begin_preroll(TapeTime at);
  [[nodiscard]] bool preroll_over();
  [[nodiscard]] std::optional<TimingFault> compare_time(const Matcher::Completion& done, TapeTime at,
                                                        Nanos error, ByteView bytes) const;

  ReplayConfig config_;
  bool half_closes_;
  bool drives_;  // the tape plays the driver
  Budget& budget_;
  Matcher& matcher_;
  SettingsCheck& settings_;
  Replies* replies_ = nullptr;
  Schedule schedule_;
  Arrivals arrivals_;
  Pieces& pieces_;
  Pace pace_;
  Gate gate_;
  TapeSessions sessions_;
  DriverLine driver_line_;

  TapeTime session_start_{};
  Seek seek_;
  std::size_t gaps_reached_ = 0;
  std::optional<Instant> writing_ended_;
  std::optional<TapeTime> missed_half_close_;
  bool holds_piece_ = false;
  ThinkTimer think_times_;

  std::uint64_t asked_ = 0;  // writes on the tape before what the device said last
  LeftOut answer_ = LeftOut::no;
  std::uint64_t doubtful_answers_ = 0;
  std::uint64_t reads_excused_ = 0;
  bool untimed_ = false;  // a gap is between the last event and the next
  bool used_up_ = false;
  bool hung_up_ = false;
  HandStep by_hand_;
  Loops loops_;
  std::uint64_t jumps_ = 0;
  std::size_t most_gaps_ = 0;  // reached before a jump back
  std::optional<TapeTime> preroll_from_;
  std::optional<Handshake> handshake_;  // in the preroll
  SignalSteps signals_;
  std::uint64_t session_bytes_ = 0;  // passed before the session
  WaitingEvents late_events_;        // of the device, passed while bytes were dropped
  bool shows_signals_ = false;
  bool answers_signal_ = false;  // nothing but signals of the device stand between the driver's and the walk
  Schedule::Totals prerolled_;
  std::optional<Instant> wake_;
  std::optional<TimingFault> fault_;
  std::optional<Instant> delivered_due_;
};

}  // namespace porttape
