#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "libport/faults/fault_plan.hpp"
#include "tools/fault_run.hpp"

namespace porttape {

// A failing case that is to become smaller: parts of a tape (TapeParts, ascending), faults on its line, and
// how a run of it went.
struct ShrinkCase {
  std::vector<std::size_t> parts;
  std::vector<Fault> faults;
  FaultRunEnd end = {};
};

// Makes a failing case smaller by trying out smaller ones: first without what comes after the failure, then
// with fewer faults, then with the faults moved to the tape's first exchanges, then with exchanges left out
// (delta debugging). Knows nothing of processes.
class Shrinker {
 public:
  // Runs cases until one of them, the first in this order, fails as it should; it gives that one's index,
  // with its `end`. Nothing where none does. With `stopped` nothing is tried any more.
  using TryAll = std::function<std::optional<std::size_t>(std::vector<ShrinkCase>& cases)>;

  Shrinker(ShrinkCase failing, TryAll try_all, std::function<bool()> stopped);

  // The smallest case found.
  const ShrinkCase& run();

 private:
  bool take_first_of(std::vector<ShrinkCase> cases);
  bool cut_behind_failure();
  bool drop_faults();
  bool simplify_faults();
  bool move_to_beginning();
  bool drop_parts();

  [[nodiscard]] std::vector<ShrinkCase> without_fault(std::size_t first, std::size_t count) const;
  [[nodiscard]] std::vector<ShrinkCase> with_parts(const std::vector<std::size_t>& parts) const;
  [[nodiscard]] std::vector<ShrinkCase> moved_to(std::size_t turn, std::size_t index) const;
  [[nodiscard]] std::optional<std::size_t> turn_of(const Fault& fault) const;
  [[nodiscard]] std::uint64_t length(std::size_t turn, LineDir dir) const;

  ShrinkCase best_;
  TryAll try_all_;
  std::function<bool()> stopped_;
  std::set<std::string> tried_;
};

// Where a turn's bytes begin in one stream.
std::uint64_t begin_of(const RequestTracker::Turn& turn, LineDir dir);

}  // namespace porttape
