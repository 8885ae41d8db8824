#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/lookup.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/pieces.hpp"
#include "libport/replay/player.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/run_ledger.hpp"
#include "libport/replay/settings_check.hpp"
#include "libport/replay/unasked.hpp"

namespace porttape {

// The runs of an engine, one after another: gives matcher and player what happens, turns what they find into
// mismatches, and ends the run with its report. Knows nothing of how sessions follow each other: the engine
// does, by the player.
//
// Drive it: begin(), then begin_session() at each open of the driver, write() and play() as things happen,
// end() when the run is over; a mismatch under `fail` or damage of the tape ends it by itself. What is to be
// done is collected in pending(). Refers to its sources, its budget and the parts, which must outlive it.
class ReplayRun {
 public:
  ReplayRun(const ReplayConfig& config, const Engine::TapeFacts& facts, const Engine::Parts& parts,
            RecordSource& schedule, RecordSource& writes, Budget& budget);
  ~ReplayRun();
  ReplayRun(const ReplayRun&) = delete;
  ReplayRun& operator=(const ReplayRun&) = delete;

  // Steering. Others of its clock stand, go on and run at that rate too.
  void stand(Instant real, bool on);
  void step(std::uint64_t exchanges);
  void set_rate(Instant now, double rate);
  void seek(Instant now, TapeTime to);
  [[nodiscard]] ReplayClock& clock() { return clock_; }
  [[nodiscard]] const ReplayClock& clock() const { return clock_; }

  // player().seek() follows.
  void begin(Instant now);
  // Of a driver that writes where the last run came to the tape's end, and that does not begin anew: all that
  // it writes is extra. Nothing is played.
  void begin_behind_end(Instant now);
  // Its driver's close, or whatever keeps it from going on to one.
  enum class EndedBy : std::uint8_t { close, other };
  void end(Instant now, EndedBy by = EndedBy::other);
  // What a driver that closes has done behind its last byte is passed. False: as far as the budget goes.
  [[nodiscard]] bool pass_to_close();
  // The driver's line is closed. Ends a run that had come to the tape's end and waited only for that.
  void line_went(Instant now);
  void stop_if_damaged(Instant now);
  [[nodiscard]] bool goes_on() const { return ledger_.has_value(); }

  // The driver has opened.
  void begin_session();
  // And that is the next loop's.
  void begin_next_loop(Instant now);
  // And that is a further session of the run.
  void count_session() {
    if (ledger_) ledger_->session();
  }
  [[nodiscard]] std::uint64_t sessions() const { return ledger_ ? ledger_->sessions() : 0; }
  // Recorded writes that the driver has not made in this loop.
  [[nodiscard]] std::optional<bool> any_writes_left() { return matcher_.any_unsent(); }
  // The driver writes no more in this session and still reads.
  void end_writing(Instant now);
  // Whether it said so, and was not told of the device's end yet; told of it now.
  bool take_writing_ended();
  // Bytes went either way in this session.
  [[nodiscard]] bool exchanged() const { return exchanged_; }
  // Nothing of this loop was played yet, which is not the first.
  [[nodiscard]] bool at_loop_begin() const { return player_.loops().fresh() && !exchanged_; }

  // Where the tape plays the driver: the line that it opened anew is there, and where the device may end it.
  void line_opened(Instant now);
  [[nodiscard]] std::optional<bool> line_may_end();

  // Gives how much of it is done with; the rest comes again. `counted`: the run's books have it already.
  std::size_t write(Instant now, ByteView data, bool counted);
  // The rest is what the driver wrote ahead of the loop's end: it belongs to the next loop, which has not
  // begun.
  [[nodiscard]] bool awaits_next_loop() const { return ledger_ && awaits_jump_ == player_.jumps(); }
  // Does what is due.
  void play(Instant now, std::size_t max_bytes, ReplayActions& out);
  // The driver has changed its line's settings or, on a line that shows them, a signal.
  void driver_did(Instant now, const LineEvent& event) {
    if (!ledger_) return;
    settings_.made(event, place_of_driver());
    player_.driver_did(now, event);
  }
  void show_signals(bool on) {
    shows_signals_ = on;
    player_.show_signals(on);
  }
  // The driver has closed, or ends its writing: what it wrote is all of this session.
  void end_of_writes(Instant now);
  // When play() is to be called next; nothing: when something has happened.
  [[nodiscard]] std::optional<Instant> wake() const;
  // Player's, with their faults told; true when it is done.
  bool settle(Instant now) { return walk(now, &Player::settle); }
  bool flush(Instant now) {
    return walk(now, &Player::flush) && (!looks_up() || lookup_->player().flush(now));
  }
  bool judge(Instant now) { return walk(now, &Player::judge); }
  // The walk has gone on to a recorded open: what the driver has not written before it is not waited for.
  void realign_to_walk();

  // The driver has read all that was delivered; a piece that is due waits for that.
  void taken(Instant now) { pieces_.taken(now); }
  [[nodiscard]] bool holds_piece() const {
    return player_.holds_piece() || (looks_up() && lookup_->player().holds_piece());
  }
  // The line takes no bytes.
  void set_blocked(bool blocked);

  [[nodiscard]] const ReplayConfig& config() const { return config_; }
  [[nodiscard]] Player& player() { return player_; }
  [[nodiscard]] const Player& player() const { return player_; }
  [[nodiscard]] std::optional<Matcher::Unsent> first_unsent();
  // What the next advance() is to give.
  [[nodiscard]] ReplayActions& pending() { return pending_; }

 private:
  void begin_books(Instant now);
  void pause_if_due(Instant now);
  void pause(Instant now);
  void compare_behind(Instant now, const Matcher::Step& step);
  bool walk(Instant now, Player::Settled (Player::*way)(Instant));
  void hung_up();
  void end_device(Instant now, ReplayActions& out);
  [[nodiscard]] bool drives() const { return config_.writer == Writer::device; }
  // What comes behind the last recorded write belongs to the next loop. A tape without writes expects none in
  // any.
  [[nodiscard]] bool another_loop() const {
    return !player_.loops().is_last() && !drives() && !behind_end_ &&
           matcher_.matched() > matched_before_loop_;
  }
  void keep_extra(Instant now, ByteView got);
  void tell_extra();
  void at_tape_end(Instant now);
  // Whether what the driver writes is looked up, and not held against what comes next on the tape.
  [[nodiscard]] bool looks_up() const { return lookup_ && (config_.match == Match::lookup || resyncing_); }
  [[nodiscard]] bool resyncs() const { return lookup_ && config_.match == Match::sequence && !behind_end_; }
  // A recorded read comes whole before anything else does. So of the walk and the answers the one that is
  // inside one goes on first.
  [[nodiscard]] bool walk_waits() const { return looks_up() && lookup_->player().inside_read(); }
  // After a mismatch what the walk still has to say comes first, too.
  [[nodiscard]] bool answers_wait() const {
    if (walk_waits()) return false;
    return player_.inside_read() || (resyncing_ && (player_.wake() || blocked_));
  }
  void resync(Instant now, ByteView rest);
  void note_question(ByteView came);
  std::size_t ask(Instant now, ByteView data);
  void find_asked(Instant now);
  void play_answers(Instant now, std::size_t max_bytes, ReplayActions& out);
  // What `out` held before it was played into.
  struct Before {
    explicit Before(const ReplayActions& out)
        : bytes(out.deliver.size()), events(out.events.size()), ended(out.end_sending) {}
    std::size_t bytes;
    std::size_t events;
    bool ended;
  };
  void count_delivered(Instant now, Before before, ReplayActions& out, std::optional<Instant> due);
  void tell_mismatch(Instant now, Mismatch mismatch);
  [[nodiscard]] Mismatch difference(Instant now, ByteView got);
  void add_mismatch(Instant now, const Mismatch& mismatch);
  [[nodiscard]] const std::optional<Error>& error();
  void tell_difference(Instant now, ByteView got);
  void tell_fault(Instant now, const Player::TimingFault& fault);
  [[nodiscard]] std::optional<bool> any_unsent();
  [[nodiscard]] SettingsCheck::Reach reach(std::optional<bool> any_unsent, EndedBy by) const;
  [[nodiscard]] SettingsReport settings_so_far(EndedBy by);
  [[nodiscard]] std::optional<SettingsCheck::Place> place_of_driver();
  [[nodiscard]] PlaybackReport playback(bool complete) const;
  [[nodiscard]] Micros since_begin(Instant now) const;
  // How far the played time is behind the real one, for the run.
  [[nodiscard]] Nanos behind() const { return clock_.shift().both() - begun_shift_.both(); }
  [[nodiscard]] std::optional<TapeTime> next_hang_up();
  [[nodiscard]] bool fails() const { return config_.on_mismatch == OnMismatch::fail; }

  ReplayConfig config_;
  std::vector<TapeTime> hang_ups_;
  std::uint64_t opens_;  // on the tape
  bool ruled_;           // something may vary
  bool leaves_out_;      // the driver may leave something out
  std::optional<TapeTotals> totals_;
  std::vector<TapeGap> gaps_;
  Budget& budget_;
  ReplayClock own_clock_;
  ReplayClock& clock_;
  SeenSettings line_;  // the device's own
  Pieces pieces_;      // what comes to the driver, from wherever
  std::unique_ptr<Replies> replies_;
  // match=lookup: plays and compares all that was asked for; on-mismatch=resync: from a mismatch on to the
  // end of the session.
  std::unique_ptr<Lookup> lookup_;
  Unasked unasked_;  // what is then the player's
  NoRecords none_;   // and the matcher's
  Matcher matcher_;
  SettingsCheck settings_;
  bool shows_signals_ = false;
  Player player_;

  std::optional<RunLedger> ledger_;           // while a run goes on
  PlaybackReport steered_;                    // by hand, in this run
  ReplayClock::Shift begun_shift_;            // when the run did
  std::uint64_t furthest_ = 0;                // of the matcher's positions before it went back
  std::optional<std::uint64_t> awaits_jump_;  // see awaits_next_loop()
  std::uint64_t matched_before_loop_ = 0;     // by the matcher
  bool tape_end_told_ = false;
  bool ends_with_line_ = false;  // the tape's end has come, and what the driver set is waited for
  bool behind_end_ = false;
  bool writing_ended_ = false;  // in this session
  bool device_gone_ = false;    // in this session: hung up as recorded
  bool sending_ended_ = false;  // in this session, by the device
  bool exchanged_ = false;
  std::uint64_t before_latest_ = 0;  // of the matcher's positions: that before what was read last
  bool blocked_ = false;
  bool was_blocked_ = false;       // since deliveries last caught up
  std::optional<Mismatch> extra_;  // of a device: told at the end, where it does not stream on
  bool resyncing_ = false;
  Bytes question_;  // resync: what the driver wrote since the last answer
  ReplayActions pending_;
};

}  // namespace porttape
