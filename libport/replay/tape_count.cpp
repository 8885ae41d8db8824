#include "libport/replay/tape_count.hpp"

namespace porttape {

std::optional<TapeTotals> count_tape(RecordSource& tape, const GiveUp& give_up) {
  TapeTotals totals;
  for (unsigned looked = 1;; ++looked) {
    if (looked % kRecordsBetweenLooks == 0 && give_up && give_up()) return std::nullopt;
    const auto record = tape.next();
    if (!record || !*record) return totals;
    if ((*record)->kind == RecordKind::read) totals.reads += (*record)->data.size();
    if ((*record)->kind == RecordKind::write) totals.writes += (*record)->data.size();
  }
}

}  // namespace porttape
