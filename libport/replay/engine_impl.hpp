#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/replay/engine.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/player.hpp"
#include "libport/replay/run_ledger.hpp"

namespace porttape {

// The life of runs and sessions: begins and ends them, and turns what matcher and player find into mismatches
// and a verdict. Driven as Engine is; what is to be done is collected in `pending` until the next advance().
struct Engine::Impl {
  // What the driver's next open means while a run goes on.
  enum class Reopen : std::uint8_t { next_open, restart_session, resume };

  Impl(const ReplayConfig& replay_config, const TapeFacts& facts, RecordSource& schedule,
       RecordSource& write_source);

  void open(Instant at);
  void write(Instant at, ByteView data);
  void close(Instant at);
  ReplayActions advance(Instant at, std::size_t max_bytes);
  std::optional<RunReport> finish(Instant at);

  void begin_run();
  void reopen();
  void end_run();
  std::optional<Reopen> meaning_of_close();
  void settle(Player::Lost lost);
  void play(std::size_t max_bytes, ReplayActions& out);
  void at_tape_end();
  void tell(Mismatch mismatch);
  void tell_difference(ByteView got);
  void tell_fault(const Player::TimingFault& fault);
  void stop_if_damaged();
  [[nodiscard]] std::uint64_t room_before_hang_up();
  [[nodiscard]] bool fails() const { return config.on_mismatch == OnMismatch::fail; }
  [[nodiscard]] bool can_realign() const { return config.strictness == 0 || !fails(); }

  ReplayConfig config;
  std::vector<std::uint64_t> hang_ups;
  RecordSource& writes;  // lent to the hint search; otherwise the matcher's
  Matcher matcher;
  Player player;

  std::optional<RunLedger> run;
  bool any_run = false;
  bool driver_open = false;
  bool writing_ended = false;  // in this session
  bool device_gone = false;    // in this session: hung up as recorded
  bool exchanged = false;      // bytes went either way in this session
  bool tape_end_told = false;
  Reopen on_open = Reopen::resume;
  bool blocked = false;
  bool was_blocked = false;  // since deliveries last caught up
  bool dirty = false;        // something happened that advance() has not seen
  Instant now{};
  ReplayActions pending;
};

}  // namespace porttape
