#include "libport/replay/tape_count.hpp"

namespace porttape {

std::optional<TapeTotals> count_tape(RecordSource& tape, const GiveUp& give_up, TapeTime start) {
  TapeTotals totals;
  for (unsigned looked = 1;; ++looked) {
    if (looked % kRecordsBetweenLooks == 0 && give_up && give_up()) return std::nullopt;
    const auto record = tape.next();
    if (!record || !*record) return totals;
    const std::size_t bytes = (*record)->data.size();
    const bool before = (*record)->at < start;
    if ((*record)->kind == RecordKind::read) {
      totals.reads += bytes;
      if (before) totals.reads_before += bytes;
    }
    if ((*record)->kind == RecordKind::write) {
      totals.writes += bytes;
      if (before) totals.writes_before += bytes;
    }
  }
}

}  // namespace porttape
