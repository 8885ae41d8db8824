#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/gate.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/schedule.hpp"

namespace porttape {

// Where the tape's sessions begin and end, seen from where the walk stands: what a driver's open goes to and
// what its close can mean. Moves the walk over what decides nothing, and plays nothing.
//
// Nothing reads more of the tape than the budget allows: what gives nothing is not known yet, ask again when
// it is refilled. Refers to all it is given, which must outlive it.
class TapeSessions {
 public:
  TapeSessions(Schedule& schedule, const Gate& gate, Matcher& matcher, const Budget& budget,
               std::uint64_t opens, Micros patience)
      : schedule_(schedule),
        gate_(gate),
        matcher_(matcher),
        budget_(budget),
        opens_(opens),
        patience_(patience) {}

  // Over what precedes `at`: to there within a session, else to the begin of the next one; gives that time.
  [[nodiscard]] std::optional<TapeTime> pass_to(TapeTime at);
  // Over all up to the next open; gives when it was, or `otherwise` where there is none.
  [[nodiscard]] std::optional<TapeTime> pass_to_next(TapeTime otherwise);

  [[nodiscard]] bool open_ahead();
  // Nothing but events and closes is left.
  [[nodiscard]] std::optional<bool> nothing_left();
  // Whether the walk stands at a recorded close or open with all writes before it complete.
  [[nodiscard]] std::optional<bool> at_recorded_reopen();
  // Nothing of the session is left to play: all of it came and went.
  [[nodiscard]] std::optional<bool> session_played();

  // Whether the other side may end its line where the walk stands, with all writes before complete: an end of
  // it is recorded there, or a close, or nothing more comes.
  [[nodiscard]] std::optional<bool> line_may_end();

  // The walk passed an open by time.
  void passed_open(Instant now) { passed_open_ = {now, schedule_.passed().writes}; }
  void forget_passed_open() { passed_open_.reset(); }
  // Whether that was so recently (`patience`), with nothing written since and something of the tape left,
  // that a close now is taken for the one before it, late.
  [[nodiscard]] std::optional<bool> just_passed_open(Instant now);

 private:
  struct PassedOpen {
    Instant when{};
    std::uint64_t writes_end = 0;
  };

  Schedule& schedule_;
  const Gate& gate_;
  Matcher& matcher_;
  const Budget& budget_;
  std::uint64_t opens_;
  Nanos patience_;
  std::optional<PassedOpen> passed_open_;
};

}  // namespace porttape
