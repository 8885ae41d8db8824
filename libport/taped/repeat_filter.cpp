#include "libport/taped/repeat_filter.hpp"

namespace porttape {

void RepeatFilter::begin_session() {
  driver_.reset();
  on_bytes();
}

void RepeatFilter::on_bytes() {
  in_since_.reset();
  out_since_.reset();
}

bool RepeatFilter::is_new(Side by, const SeenSettings& settings) {
  std::optional<SeenSettings>& last = by == Side::driver ? driver_ : device_;
  const SeenSettings line = settings.over(line_);
  if (last == settings && line == line_) return false;
  last = settings;
  line_ = line;
  return true;
}

bool RepeatFilter::is_new(FlushQueue queue, Instant now) {
  bool any = false;
  const auto flush = [&](FlushQueue other, std::optional<Instant>& since) {
    if (queue == other || (since && now - *since < kFlushes)) return;
    since = now;
    any = true;
  };
  flush(FlushQueue::out, in_since_);
  flush(FlushQueue::in, out_since_);
  return any;
}

}  // namespace porttape
