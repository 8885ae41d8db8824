#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "libport/replay/budget.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/player.hpp"
#include "libport/replay/run_ledger.hpp"

namespace porttape {

// The life of runs and sessions: begins and ends them, and turns what matcher and player find into mismatches
// and a verdict. Driven as Engine is; what is to be done is collected in `pending` until the next advance().
//
// What it is told becomes an input, which is worked on at once as far as the budget goes and else waits, with
// all that follow it, for the next advance().
struct Engine::Impl {
  // What the driver's next open means while a run goes on.
  enum class Reopen : std::uint8_t { next_open, restart_session, resume };

  Impl(const ReplayConfig& replay_config, const TapeFacts& facts, RecordSource& schedule,
       RecordSource& write_source, const Parts& parts);

  struct Input {
    enum class Kind : std::uint8_t { open, write, writing_ended, flush, close, finish };
    Kind kind = Kind::write;
    Instant at{};
    Bytes data{};          // write
    std::size_t used = 0;  // of data
    // open, close: what it means is settled, and the walk is on its way; write: the run's books have it
    bool begun = false;
  };

  void tell(Input input);
  void tell_write(Instant at, ByteView data);
  ReplayActions advance(Instant at, std::size_t max_bytes);
  void give_up(Instant at);

  void work();
  bool work_on(Input& input);
  bool open(Input& input);
  bool reopen();
  std::size_t write(ByteView data, bool counted);
  bool close(Input& input);
  bool finish();
  // Whether the line is on its way to another state: nothing is played meanwhile.
  [[nodiscard]] bool switching() const;

  void begin_run();
  void end_run();
  // What the driver's close means.
  struct Close {
    bool known = false;            // else to be asked again
    bool judge = false;            // the writes made ahead of the walk are to be judged
    std::optional<Reopen> next{};  // what its next open is; nothing when the run is over
  };
  Close meaning_of_close();
  bool judge();
  bool settle();
  bool flush();
  bool tell_settled(const Player::Settled& settled);
  void play(std::size_t max_bytes, ReplayActions& out);
  void at_tape_end();
  void tell_mismatch(Mismatch mismatch);
  void tell_difference(ByteView got);
  void tell_fault(const Player::TimingFault& fault);
  void add_gaps(RunReport& report);
  void stop_if_damaged();
  [[nodiscard]] std::optional<TapeTime> next_hang_up();
  [[nodiscard]] bool fails() const { return config.on_mismatch == OnMismatch::fail; }
  [[nodiscard]] bool can_realign() const { return config.strictness == 0 || !fails(); }

  ReplayConfig config;
  std::vector<TapeTime> hang_ups;
  std::optional<TapeTotals> totals;
  std::vector<TapeGap> gaps;
  Budget budget;
  ReplayClock own_clock;
  Matcher matcher;
  Player player;

  std::optional<RunLedger> run;
  bool any_run = false;
  bool driver_open = false;
  bool writing_ended = false;  // in this session
  bool device_gone = false;    // in this session: hung up as recorded
  bool resuming = false;       // the open that is worked on goes on where the walk was
  bool exchanged = false;      // bytes went either way in this session
  bool tape_end_told = false;
  Close closing;  // the last close's
  Reopen on_open = Reopen::resume;
  bool blocked = false;
  bool was_blocked = false;  // since deliveries last caught up
  bool dirty = false;        // something happened that advance() has not seen
  Instant now{};
  std::deque<Input> inputs;
  std::size_t backlog = 0;  // bytes of theirs
  bool finished = false;
  ReplayActions pending;
};

}  // namespace porttape
