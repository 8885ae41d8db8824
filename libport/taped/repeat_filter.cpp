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

bool RepeatFilter::is_new(const TapedLineEvent& event, Instant now) {
  if (const auto* settings = std::get_if<line::Settings>(&event.what))
    return is_new(event.by, settings->seen);
  if (const auto* flush = std::get_if<line::Flush>(&event.what)) return is_new(flush->queue, now);
  return true;
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
  const auto is_new = [&](FlushQueue other, const std::optional<Instant>& since) {
    return queue != other && (!since || now - *since >= kFlushes);
  };
  if (!is_new(FlushQueue::out, in_since_) && !is_new(FlushQueue::in, out_since_)) return false;
  if (queue != FlushQueue::out) in_since_ = now;
  if (queue != FlushQueue::in) out_since_ = now;
  return true;
}

}  // namespace porttape
