#include "libport/replay/settings_check.hpp"

#include <algorithm>
#include <utility>
#include <variant>

#include "libport/tape/event.hpp"

namespace porttape {
namespace {

// Of either side. Comparing takes their product.
constexpr std::size_t kMostHeld = 128;

template <class Value>
bool agree(const std::optional<Value>& one, const std::optional<Value>& other) {
  return !one || !other || *one == *other;
}

// In all that is known of both.
bool agree(const SeenSettings& one, const SeenSettings& other) {
  return agree(one.baud, other.baud) && agree(one.data_bits, other.data_bits) &&
         agree(one.parity, other.parity) && agree(one.stop_bits, other.stop_bits) &&
         agree(one.hw_flow, other.hw_flow) && agree(one.sw_flow, other.sw_flow);
}

// A signal is another change than settings.
bool agree(const LineView& one, const LineView& other) {
  return agree(one.settings, other.settings) && one.dtr == other.dtr && one.rts == other.rts &&
         one.brk == other.brk;
}

}  // namespace

void SettingsCheck::Keys::add(const SeenSettings& known) {
  baud = baud || known.baud;
  data_bits = data_bits || known.data_bits;
  parity = parity || known.parity;
  stop_bits = stop_bits || known.stop_bits;
  hw_flow = hw_flow || known.hw_flow;
  sw_flow = sw_flow || known.sw_flow;
}

LineView SettingsCheck::Keys::of(LineView line) const {
  SeenSettings& settings = line.settings;
  if (!baud) settings.baud.reset();
  if (!data_bits) settings.data_bits.reset();
  if (!parity) settings.parity.reset();
  if (!stop_bits) settings.stop_bits.reset();
  if (!hw_flow) settings.hw_flow.reset();
  if (!sw_flow) settings.sw_flow.reset();
  return signals ? line : LineView::of(settings);
}

void SettingsCheck::begin(const SeenSettings& line, bool shows_signals) {
  *this = {};
  line_ = LineView::opened();
  line_.settings = line;
  shows_signals_ = shows_signals;
}

void SettingsCheck::pass(const Record& record, std::uint64_t writes, bool expected) {
  if (record.kind == RecordKind::write && !record.data.empty() && stand_ == Stand::question)
    stand_ = Stand::answer;
  if (record.kind == RecordKind::read && !record.data.empty() && stand_ == Stand::answer)
    stand_ = Stand::sure;
  if (record.kind == RecordKind::close) {
    end_latest(record.at);
    for (Taped& each : taped_) each.range.close(writes);
  }
  if (record.kind == RecordKind::open || record.kind == RecordKind::write) before_latest_ = writes;
  if (record.kind == RecordKind::open) ++opens_;
  const Place place{writes, before_latest_, opens_};
  if (record.kind == RecordKind::open && shows_signals_)
    add_taped({record.at, LineView::opened(), false, Range::of(SettingsOrder::exact, place), writes});
  if (record.event == nullptr) return;
  if (const auto signal = signal_of(*record.event)) {
    if (shows_signals_ && signal->by == Side::driver)
      add_taped({record.at, LineView::of(signal->signal), expected, Range::of(SettingsOrder::exact, place),
                 writes});
    return;
  }
  const auto* settings = std::get_if<event::Settings>(record.event);
  if (settings == nullptr || !settings->by) return;
  const bool by_driver = *settings->by == Side::driver && expected;
  if (by_driver) end_latest(record.at);
  const Range range = Range::of(settings->order.value_or(SettingsOrder::sampled), place);
  add_taped({record.at, LineView::of(settings->line), by_driver, range, writes});
  if (by_driver && !shows_signals_) stand_ = Stand::question;
}

void SettingsCheck::add_taped(const Taped& taped) {
  if (taped_.size() == kMostHeld) settle();
  taped_.push_back(taped);
}

// The latest of the driver's on the tape is replaced, or its line closed.
void SettingsCheck::end_latest(TapeTime at) {
  if (std::exchange(stand_, Stand::sure) == Stand::sure) return;
  const auto latest =
      std::find_if(taped_.rbegin(), taped_.rend(), [](const Taped& t) { return t.by_driver; });
  if (latest != taped_.rend()) latest->seen = at - latest->at >= kSeenAfter;
}

void SettingsCheck::made(const LineEvent& event, std::optional<Place> place) {
  const auto range = [place](SettingsOrder order) { return place ? Range::of(order, *place) : Range{}; };
  if (const auto* signal = std::get_if<LineSignal>(&event))
    return add_made({LineView::of(*signal), range(SettingsOrder::exact)});
  const auto* settings = std::get_if<line::Settings>(&event);
  if (settings == nullptr) return;
  if (!keys_) keys_ = Keys{false, false, false, false, false, false, shows_signals_};
  keys_->add(settings->seen);
  add_made({LineView::of(settings->seen), range(settings->order)});
}

void SettingsCheck::closed(std::uint64_t written) {
  for (Made& each : made_) each.range.close(written);
}

void SettingsCheck::add_made(const Made& made) {
  if (made_.size() == kMostHeld) settle();
  made_.push_back(made);
}

// Each that changes what the replaying line shows. What may not have been seen is taken for not made.
std::vector<std::size_t> SettingsCheck::required(const Keys& keys, std::size_t end) const {
  std::vector<std::size_t> places;
  LineView line = keys.of(line_);
  for (std::size_t i = 0; i < end; ++i) {
    const Taped& each = taped_[i];
    if (!each.seen) continue;
    const LineView next = keys.of(each.what).over(line);
    if (each.by_driver && next != line) places.push_back(i);
    line = next;
  }
  return places;
}

// The longest sequence that both have: first how long it is behind each pair of places.
SettingsCheck::Outcome SettingsCheck::compare(std::size_t end, bool by_session) const {
  Keys keys = keys_.value_or(Keys{});
  keys.signals = shows_signals_;
  Outcome outcome;
  outcome.required = required(keys, end);
  const std::size_t rows = outcome.required.size();
  const std::size_t columns = made_.size();
  outcome.made.resize(rows);
  std::vector<std::uint16_t> lengths((rows + 1) * (columns + 1));
  const auto length = [&](std::size_t row, std::size_t column) -> std::uint16_t& {
    return lengths[row * (columns + 1) + column];
  };
  const auto same = [&](std::size_t row, std::size_t column) {
    const Taped& taped = taped_[outcome.required[row]];
    const Made& made = made_[column];
    return taped.range.meets(made.range, by_session) && agree(keys.of(taped.what), made.what);
  };
  for (std::size_t row = rows; row-- > 0;) {
    for (std::size_t column = columns; column-- > 0;) {
      const int both = length(row + 1, column + 1) + 1;
      const int one = std::max(length(row + 1, column), length(row, column + 1));
      length(row, column) = static_cast<std::uint16_t>(same(row, column) ? both : one);
    }
  }
  for (std::size_t row = 0, column = 0; row < rows && column < columns;) {
    if (same(row, column)) {
      outcome.made[row] = true;
      outcome.taped_end = outcome.required[row++] + 1;
      outcome.made_end = ++column;
    } else if (length(row, column + 1) >= length(row + 1, column)) {
      ++column;  // of equals the one with the earlier ones on the tape
    } else {
      ++row;
    }
  }
  return outcome;
}

void SettingsCheck::add(const Outcome& outcome, std::size_t end, SettingsReport& to) const {
  for (std::size_t i = 0; i < outcome.required.size() && outcome.required[i] < end; ++i) {
    const Taped& each = taped_[outcome.required[i]];
    ++to.recorded;
    if (outcome.made[i]) {
      ++to.made;
    } else if (to.missing.size() < SettingsReport::kMostMissing) {
      to.missing.push_back({each.at, each.what});
    }
  }
}

// One side is full: what is compared up to the last that was made is done with, or half of the full one.
void SettingsCheck::settle() {
  const Outcome outcome = compare(taped_.size(), false);
  std::size_t taped = outcome.taped_end;
  std::size_t made = outcome.made_end;
  if (taped_.size() == kMostHeld) taped = std::max(taped, kMostHeld / 2);
  if (made_.size() == kMostHeld) made = std::max(made, kMostHeld / 2);
  add(outcome, taped, settled_);
  for (std::size_t i = 0; i < taped; ++i) line_ = taped_[i].what.over(line_);
  taped_.erase(taped_.begin(), taped_.begin() + static_cast<std::ptrdiff_t>(taped));
  made_.erase(made_.begin(), made_.begin() + static_cast<std::ptrdiff_t>(made));
  delivered_ -= std::min(delivered_, taped);
}

SettingsReport SettingsCheck::report(Reach reach, std::uint64_t writes, std::uint64_t sessions) const {
  const std::size_t sure = reach == Reach::all ? taped_.size() : reach == Reach::delivered ? delivered_ : 0;
  std::size_t end = taped_.size();
  while (end > sure && taped_[end - 1].writes >= writes) --end;
  SettingsReport report = settled_;
  add(compare(end, sessions == opens_), end, report);
  return report;
}

}  // namespace porttape
