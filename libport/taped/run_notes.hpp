#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/line/line_event.hpp"
#include "libport/loop/loop.hpp"
#include "libport/replay/output_flushes.hpp"
#include "libport/replay/report.hpp"
#include "libport/taped/unread_tally.hpp"

namespace porttape {

// What a run's report has besides what the engine knows of the run: when it began, faults, and what leaves
// its verdict in doubt. The loop must outlive it. Loop thread only.
//
// Drive it: open() at each of the driver's opens, and begin() once its line is up; tell what happens;
// end_run() when the engine has ended the run; add_left() once its drivers have gone, or will not be waited
// for.
class RunNotes {
 public:
  explicit RunNotes(const Loop& loop) : loop_(loop) {}

  void open();
  void begin(Instant now);
  // Since the last end_run().
  [[nodiscard]] bool begun() const { return begun_.has_value(); }

  void written(std::size_t bytes) { written_ += bytes; }
  void delivered() { unread_.delivered(); }
  void output_flushed() { output_flushes_.add(written_); }
  void input_flushed() { unread_.flushed(); }
  void left_unread(const line::LeftUnread& left) { unread_.told(left); }
  void close() { unread_.close_session(); }
  void refused(const line::Refused& refused);
  void fault(const LineFault& fault);

  // `of_tape`: the doubts that the tape itself leaves, where somebody came to it.
  void end_run(RunReport& report, const std::vector<Doubt>& of_tape);
  void add_left(RunReport& report);
  // Who was turned away since add_left(), and what nobody has judged of theirs.
  [[nodiscard]] std::optional<Doubt> take_refused();

 private:
  void add_output_flushes(RunReport& report);
  void add_stalls(RunReport& report, Instant begun) const;

  const Loop& loop_;
  std::optional<Instant> begun_;
  std::uint64_t written_ = 0;  // bytes of the driver's
  OutputFlushes output_flushes_;
  UnreadTally unread_;
  std::optional<FaultsReport> faults_;
  std::uint64_t refused_ = 0;
  std::uint64_t refused_bytes_ = 0;
};

}  // namespace porttape
