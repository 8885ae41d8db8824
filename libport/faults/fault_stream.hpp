#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "libport/faults/fault_plan.hpp"
#include "libport/faults/fault_watch.hpp"

namespace porttape {

// What a plan makes of one stream of a line: tells of each arrival what is to be passed on instead, and when.
// Pure: no clock, no I/O.
class FaultStream {
 public:
  // Bytes of a frame that is doubled beyond these come once.
  static constexpr std::size_t kMostDoubled = std::size_t{64} << 10;

  struct Piece {
    Bytes data;
    Instant due;  // the past: at once
  };
  struct Outcome {
    bool untouched = true;      // all passes at once as it is, and `pieces` is empty
    std::vector<Piece> pieces;  // each an arrival of its own
    std::vector<LineFault> faults;
    const Fault* broken = nullptr;  // the line breaks, behind the pieces
  };

  // `plan` outlives it. In datagrams each arrival is one.
  FaultStream(const FaultPlan& plan, std::uint64_t seed, LineDir dir, bool datagrams);

  // The next arrival, at `now`; the line first came up at `zero`.
  Outcome take(ByteView arrival, Instant now, Instant zero);

 private:
  struct Watched {
    const Fault* fault;
    FaultWatch watch;
    Bytes doubled = {};  // so far, of a strike
  };
  struct Marks;

  [[nodiscard]] ByteView up_to_break(ByteView arrival, Nanos elapsed, Outcome& outcome) const;
  void mark(Watched& watched, std::uint64_t begin, const std::vector<FaultWatch::Hit>& hits, Marks& marks);
  void note(Watched& watched, std::uint64_t position, Outcome& outcome) const;
  void hold(const Fault& fault, std::size_t at, Marks& marks);
  void double_bytes(Watched& watched, const FaultWatch::Hit& hit, Marks& marks) const;
  void put_together(Marks& marks, Outcome& outcome) const;

  LineDir dir_;
  bool datagrams_;
  std::vector<Watched> watched_;
  Instant stands_until_{};  // by a stall
};

}  // namespace porttape
