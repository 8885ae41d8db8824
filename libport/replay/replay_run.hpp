#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/player.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/run_ledger.hpp"

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

  // player().seek() follows.
  void begin(Instant now);
  void end(Instant now);
  void stop_if_damaged(Instant now);
  [[nodiscard]] bool goes_on() const { return ledger_.has_value(); }

  // The driver has opened.
  void begin_session();
  // And that is a further session of the run.
  void count_session() { ++sessions_; }
  // The driver writes no more in this session and still reads.
  void end_writing(Instant now);
  // Whether it said so, and was not told of the device's end yet; told of it now.
  bool take_writing_ended();
  // Bytes went either way in this session.
  [[nodiscard]] bool exchanged() const { return exchanged_; }

  // Gives how much of it is done with; the rest comes again. `counted`: the run's books have it already.
  std::size_t write(Instant now, ByteView data, bool counted);
  // Does what is due.
  void play(Instant now, std::size_t max_bytes, ReplayActions& out);
  // The driver pauses: a field whose end has not shown ends here.
  void pause(Instant now);
  // When play() is to be called next; nothing: when something has happened.
  [[nodiscard]] std::optional<Instant> wake() const;
  // Player's, with their faults told; true when it is done.
  bool settle(Instant now) { return walk(now, &Player::settle); }
  bool flush(Instant now) { return walk(now, &Player::flush); }
  bool judge(Instant now) { return walk(now, &Player::judge); }
  // The walk has gone on to a recorded open: what the driver has not written before it is not waited for.
  void realign_to_walk();

  void set_totals(const TapeTotals& totals) { totals_ = totals; }
  // The line takes no bytes.
  void set_blocked(bool blocked);

  [[nodiscard]] const ReplayConfig& config() const { return config_; }
  [[nodiscard]] Player& player() { return player_; }
  [[nodiscard]] const Player& player() const { return player_; }
  [[nodiscard]] std::optional<Matcher::Unsent> first_unsent();
  // What the next advance() is to give.
  [[nodiscard]] ReplayActions& pending() { return pending_; }

 private:
  void pause_if_due(Instant now);
  bool walk(Instant now, Player::Settled (Player::*way)(Instant));
  void end_device(Instant now, ReplayActions& out);
  void at_tape_end(Instant now);
  void tell_mismatch(Instant now, Mismatch mismatch);
  void tell_difference(Instant now, ByteView got);
  void tell_fault(Instant now, const Player::TimingFault& fault);
  void add_gaps(RunReport& report) const;
  [[nodiscard]] std::optional<TapeTime> next_hang_up();
  [[nodiscard]] bool fails() const { return config_.on_mismatch == OnMismatch::fail; }

  ReplayConfig config_;
  std::vector<TapeTime> hang_ups_;
  std::uint64_t opens_;  // on the tape
  std::optional<TapeTotals> totals_;
  std::vector<TapeGap> gaps_;
  Budget& budget_;
  ReplayClock own_clock_;
  ReplayClock& clock_;
  Matcher matcher_;
  Player player_;

  std::optional<RunLedger> ledger_;  // while a run goes on
  std::uint64_t writes_ = 0;         // of the driver in this run
  std::uint64_t write_begin_ = 0;    // where in its stream the latest began
  std::uint64_t sessions_ = 0;       // of the driver's in this run
  bool tape_end_told_ = false;
  bool writing_ended_ = false;  // in this session
  bool device_gone_ = false;    // in this session: hung up as recorded
  bool exchanged_ = false;
  bool blocked_ = false;
  bool was_blocked_ = false;  // since deliveries last caught up
  ReplayActions pending_;
};

}  // namespace porttape
