#include "libport/tape/event_salvage.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "libport/tape/event_file.hpp"

namespace porttape {

void EventSalvage::lose(std::uint64_t number, std::string why) {
  if (!lost_) lost_ = LostLines{number, 0, std::move(why)};
  lost_->line = std::min(lost_->line, number);
  ++lost_->lines;
}

// Of a line that is too long only its beginning is kept.
Result<bool> EventSalvage::read_line() {
  text_.clear();
  wrong_.clear();
  bool any = false;
  for (;;) {
    if (const std::uint64_t data = stored_.behind_hole(offset_); data != offset_) {
      wrong_ = "a hole in the file";
      offset_ = data;
      ++number_;
      return true;
    }
    const auto view = window_.view(offset_, EventFile::kMaxLine);
    if (!view) return view.error();
    if (view->empty() || offset_ >= size_) {
      wrong_ = any ? "an unfinished line" : "";
      number_ += any ? 1 : 0;
      return any;
    }
    any = true;
    const auto* end = static_cast<const Byte*>(std::memchr(view->data(), '\n', view->size()));
    const std::size_t length = end == nullptr ? view->size() : static_cast<std::size_t>(end - view->data());
    if (text_.size() + length < EventFile::kMaxLine) {
      text_.append(as_text(view->first(length)));
    } else {
      wrong_ = "longer than " + std::to_string(EventFile::kMaxLine) + " bytes";
    }
    offset_ += length + (end == nullptr ? 0 : 1);
    if (end == nullptr) continue;
    ++number_;
    return true;
  }
}

// Looks as far ahead as the order of times needs.
Result<void> EventSalvage::fill() {
  while (ahead_.size() < kLookAhead) {
    const auto read = read_line();
    if (!read) return read.error();
    if (!*read) return {};
    take_line();
    lines_.add(as_bytes(text_ + '\n'));
  }
  return {};
}

void EventSalvage::take_line() {
  if (number_ == 1 && wrong_.empty() && decode_header(text_)) {
    header_line_ = text_;
    return;
  }
  auto event =
      wrong_.empty() ? decode_event(text_) : Result<TapeEvent>(make_error(Errc::damaged_tape, wrong_));
  if (const Result<void> sealed = event ? check_seal(text_, event->what) : Result<void>(); !sealed)
    event = sealed.error();
  if (!event) return lose(number_, number_ == 1 ? "it is no header" : event.error().message);
  const auto* end = std::get_if<event::End>(&event->what);
  const bool others_changed = end != nullptr && end->events && *end->events != lines_.value();
  ahead_.push_back({*event, text_, number_, others_changed});
}

// Takes out a line whose time does not fit, if there is one among the next.
bool EventSalvage::drop_misplaced() {
  if (ahead_.empty()) return false;
  const TapeTime first = ahead_[0].event.at;
  std::size_t bad = 0;
  if (first >= last_) {
    if (ahead_.size() < 2 || ahead_[1].event.at >= first) return false;
    const bool second = ahead_[1].event.at < last_ || (ahead_.size() > 2 && ahead_[2].event.at >= first);
    bad = second ? 1 : 0;
  }
  lose(ahead_[bad].number,
       "its time, " + std::to_string(to_us(ahead_[bad].event.at)) + " us, is out of order");
  ahead_.erase(ahead_.begin() + static_cast<std::ptrdiff_t>(bad));
  return true;
}

Result<EventSalvage::Step> EventSalvage::next() {
  do {
    if (const auto filled = fill(); !filled) return filled.error();
  } while (drop_misplaced());
  const bool before = lost_ && (ahead_.empty() || lost_->line < ahead_.front().number);
  Step step{before ? std::exchange(lost_, std::nullopt) : std::nullopt, std::nullopt};
  if (ahead_.empty()) return step;
  last_ = ahead_.front().event.at;
  step.line = std::move(ahead_.front());
  ahead_.pop_front();
  return step;
}

}  // namespace porttape
