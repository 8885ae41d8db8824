#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/pace.hpp"
#include "libport/replay/replay_config.hpp"

namespace porttape {

// What holds a read back until the driver has written what precedes it on the tape (timing reactive and
// none): the run of write records before the read, taken as one question. It opens by the question's last
// byte, and where that may never come, by the driver's silence. When it opens, the pace goes on from there.
//
// The walk tells it of writes and gaps as it passes them, and asks it for what comes behind. Refers to the
// matcher and the pace, which must outlive it.
class Gate {
 public:
  struct Answer {
    bool open = false;
    std::optional<Instant> until{};  // ask again then; nothing: when the driver has done something
  };
  // The silence that opens it: after the driver has written something, or since what is behind it was due.
  struct Silence {
    Instant end{};
    bool after_writing = false;
  };

  Gate(const ReplayConfig& config, Matcher& matcher, Pace& pace)
      : always_lenient_(config.strictness == 0),
        quiet_(config.quiet),
        patience_(config.patience),
        matcher_(matcher),
        pace_(pace) {}

  void begin_run();
  // The walk is at a session's begin, behind so many recorded bytes of writes.
  void begin_session(std::uint64_t writes);

  // The question goes on to the recorded byte `end`, written at `at`.
  void add_write(std::uint64_t end, TapeTime at);
  // A question may be missing before what comes next.
  void add_gap(TapeTime at, bool may_miss);
  // A question up to `end` has been asked and judged elsewhere.
  void pass(std::uint64_t end, TapeTime at, Instant real);

  // Whether the question has been asked, with `next_at` the recorded time of what waits behind it.
  [[nodiscard]] Answer open(Instant now, TapeTime next_at);

  // From the run's first difference on (and always at strictness 0) it also opens by quiet and patience.
  void become_lenient(Instant now);
  // Writes have come that the matcher has not been given yet: no silence counts meanwhile.
  void set_behind(bool behind) { behind_ = behind; }

  [[nodiscard]] bool lenient() const { return lenient_; }
  [[nodiscard]] bool silence_counts() const { return lenient_ && !behind_; }
  [[nodiscard]] Silence next_silence(TapeTime next_at) const;
  [[nodiscard]] Instant patience_end(TapeTime next_at) const;

  [[nodiscard]] bool pending() const { return pending_; }
  // The driver's bytes have come up to its end.
  [[nodiscard]] bool asked() const { return !pending_ || matcher_.position() >= end_; }
  // When its last write was.
  [[nodiscard]] TapeTime at() const { return at_; }

 private:
  void opened(TapeTime tape, Instant real, Instant not_before);
  // Behind a gap a driver whose bytes the tape does not have would wait for its answer for ever.
  [[nodiscard]] bool in_gap() const { return !behind_ && (gap_ || matcher_.astray()); }

  bool always_lenient_;
  Nanos quiet_;
  Nanos patience_;
  Matcher& matcher_;
  Pace& pace_;

  bool pending_ = false;
  std::uint64_t begin_ = 0;  // recorded bytes before the question
  std::uint64_t end_ = 0;
  TapeTime at_{};
  bool gap_ = false;
  bool behind_ = false;
  bool lenient_ = false;
  Instant lenient_since_{};
};

}  // namespace porttape
