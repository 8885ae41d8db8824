#include "libport/replay/schedule.hpp"

#include <algorithm>
#include <variant>

#include "libport/tape/event.hpp"

namespace porttape {

void Schedule::rewind() {
  restart();
  records_told_ = 0;
  output_flushes_ = {};
  input_flushes_ = 0;
}

void Schedule::restart() {
  head_.reset();
  loaded_ = false;
  taken_ = 0;
  piece_passed_ = false;
  passed_ = {};
  latest_ = {};
  records_passed_ = 0;
  breaks_passed_ = 0;
  opens_passed_ = 0;
  hang_ups_passed_ = 0;
  gaps_passed_ = 0;
  output_flushes_.restart();
  exchange_ = 0;
  answered_ = true;
  line_closed_ = false;
  device_signals_.clear();
  error_.reset();
  if (auto result = source_.rewind(); !result) error_ = result.error();
}

const Record* Schedule::head() {
  if (!loaded_ && !error_) {
    loaded_ = true;
    auto record = source_.next();
    if (record) {
      head_ = *record;
    } else {
      error_ = record.error();
      head_.reset();
    }
  }
  return head_ && !error_ ? &*head_ : nullptr;
}

void Schedule::pop() { pass(true); }
void Schedule::skip() { pass(false); }

void Schedule::take(std::size_t count) {
  taken_ += count;
  if (count > 0 && head_) latest_ = std::max(latest_, head_->at);
}

void Schedule::pass(bool expected) {
  const Record* record = head();
  if (record == nullptr) return;
  budget_.spend(record->data.size());
  latest_ = std::max(latest_, record->at);
  piece_passed_ = record->kind == RecordKind::read && !record->last_piece();
  if (++records_passed_ > records_told_) {
    records_told_ = records_passed_;
    settings_.pass(*record, passed_.writes, expected);
  }
  switch (record->kind) {
    case RecordKind::read:
      passed_.reads += record->data.size();
      if (!record->data.empty()) answered_ = true;
      break;
    case RecordKind::write:
      passed_.writes += record->data.size();
      if (record->data.empty()) break;
      ++breaks_passed_;
      if (answered_) ++exchange_;
      answered_ = false;
      break;
    case RecordKind::open:
      ++breaks_passed_;
      ++opens_passed_;
      line_closed_ = false;
      device_signals_.clear();
      break;
    case RecordKind::close:
      ++breaks_passed_;
      line_closed_ = true;
      break;
    case RecordKind::hang_up:
      ++breaks_passed_;
      ++hang_ups_passed_;
      break;
    case RecordKind::half_close:
      ++breaks_passed_;
      break;
    case RecordKind::gap:
      ++gaps_passed_;
      break;
    case RecordKind::event:
      pass_event(record->event);
      break;
  }
  loaded_ = false;
  taken_ = 0;
}

void Schedule::pass_event(const Event* event) {
  if (event == nullptr) return;
  const auto signal = signal_of(*event);
  if (signal && signal->by == Side::device) device_signals_[signal->signal.name] = signal->signal;
  const auto* flush = std::get_if<event::Flush>(event);
  if (flush != nullptr && flush->queue != FlushQueue::out) ++input_flushes_;
  if (flush == nullptr || flush->queue == FlushQueue::in) return;
  output_flushes_.add(passed_.writes);
}

ByteView Schedule::rest() {
  const Record* record = head();
  return record == nullptr ? ByteView{} : record->data.subspan(taken_);
}

void Schedule::pass_write(std::uint64_t offset) {
  while (passed_.writes <= offset && !spent() && head() != nullptr) pop();
}

std::uint64_t Schedule::exchange_of(std::uint64_t offset) {
  const Record* record = head();
  const bool ahead =
      offset >= passed_.writes && record != nullptr && (answered_ || record->kind == RecordKind::read);
  return std::max<std::uint64_t>(1, exchange_ + (ahead ? 1 : 0));
}

}  // namespace porttape
