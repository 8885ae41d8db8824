#include "libport/port/filter_port.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace porttape {

FilterPort::FilterPort(const PortContext& context, std::unique_ptr<Port> inner)
    : ForwardingPort(std::move(inner)),
      in_{Timer(*context.loop, [this] { run_in(When::due); })},
      out_{Timer(*context.loop, [this] { run_out(When::due); })} {}

void FilterPort::close() {
  const std::size_t bytes = in_.bytes + out_.bytes;
  for (Lane* lane : {&in_, &out_}) {
    lane->steps.clear();
    lane->bytes = 0;
    lane->timer.cancel();
  }
  ForwardingPort::close();
  let_inner_read();
  if (bytes > 0) ForwardingPort::on_dropped(bytes, "they were held back when the line was closed");
}

bool FilterPort::congested() const { return !out_.steps.empty() || ForwardingPort::congested(); }

bool FilterPort::end_writing() {
  run_out(When::now);
  return ForwardingPort::end_writing();
}

std::optional<std::size_t> FilterPort::unread_by_peer() const {
  const std::optional<std::size_t> unread = ForwardingPort::unread_by_peer();
  return unread ? std::optional(*unread + out_.bytes) : std::nullopt;
}

void FilterPort::set_reading(bool on) {
  reading_ = on;
  inner_reads_ = on && in_.bytes < kMostWaiting;
  ForwardingPort::set_reading(inner_reads_);
  if (on && !in_.steps.empty()) in_.timer.set(in_.steps.front().due);
}

void FilterPort::let_inner_read() {
  const bool on = reading_ && in_.bytes < kMostWaiting;
  if (on == std::exchange(inner_reads_, on)) return;
  ForwardingPort::set_reading(on);
}

void FilterPort::hang_up(bool after_reading) {
  run_out(When::now);
  ForwardingPort::hang_up(after_reading);
}

void FilterPort::read_pending() {
  ForwardingPort::read_pending();
  run_in(When::now);
}

void FilterPort::deliver(ByteView arrival, Instant due) {
  if (in_.steps.empty() && reading_ && due <= Loop::now()) {
    ForwardingPort::on_data(arrival);
    return;
  }
  put(in_, {due, Bytes(arrival.begin(), arrival.end()), {}});
  let_inner_read();
}

void FilterPort::send(ByteView data, Instant due) {
  if (out_.steps.empty() && due <= Loop::now()) {
    ForwardingPort::write(data);
    return;
  }
  put(out_, {due, Bytes(data.begin(), data.end()), {}});
}

void FilterPort::drop(std::uint64_t bytes, std::string_view why) { on_dropped(bytes, why); }

void FilterPort::on_arrivals(ByteView data, std::span<const std::size_t> ends) {
  for_each_arrival(data, ends, [this](ByteView arrival) { incoming(arrival); });
}

void FilterPort::tell(std::function<void()> event) {
  if (in_.steps.empty()) {
    event();
  } else {
    put(in_, {{}, {}, std::move(event)});
  }
}

void FilterPort::on_up() {
  tell([this] { ForwardingPort::on_up(); });
}
void FilterPort::on_down(const LineDown& down) {
  tell([this, down] { ForwardingPort::on_down(down); });
}
void FilterPort::on_interrupted(const LineDown& down) {
  tell([this, down] { ForwardingPort::on_interrupted(down); });
}
void FilterPort::on_resumed() {
  tell([this] { ForwardingPort::on_resumed(); });
}
void FilterPort::on_settings(const SeenSettings& settings) {
  tell([this, settings] { ForwardingPort::on_settings(settings); });
}
void FilterPort::on_dropped(std::uint64_t bytes, std::string_view why) {
  tell([this, bytes, why = std::string(why)] { ForwardingPort::on_dropped(bytes, why); });
}

PortListener::Answers FilterPort::on_ended() {
  run_in(When::now);
  return ForwardingPort::on_ended();
}

std::size_t FilterPort::write_some(ByteView data) {
  if (congested()) return 0;
  outgoing(data);
  return data.size();
}

bool FilterPort::discard() {
  for (Lane* lane : {&in_, &out_}) {
    std::erase_if(lane->steps, [](const Step& step) { return !step.event; });
    lane->bytes = 0;
  }
  run_in(When::now);
  let_inner_read();
  return ForwardingPort::discard();
}

std::optional<Instant> FilterPort::next_due() {
  std::optional<Instant> next = ForwardingPort::next_due();
  for (const Lane* lane : {&in_, &out_}) {
    const std::optional<Instant> due = lane->timer.due();
    if (due && (!next || *due < *next)) next = due;
  }
  return next;
}

void FilterPort::put(Lane& lane, Step step) {
  if (!lane.steps.empty()) step.due = std::max(step.due, lane.steps.back().due);
  lane.bytes += step.data.size();
  lane.steps.push_back(std::move(step));
  if (lane.steps.size() == 1) lane.timer.set(lane.steps.front().due);
}

FilterPort::Step FilterPort::take(Lane& lane) {
  Step step = std::move(lane.steps.front());
  lane.steps.pop_front();
  lane.bytes -= step.data.size();
  return step;
}

bool FilterPort::is_due(const Lane& lane, When when) {
  return !lane.steps.empty() && (when == When::now || lane.steps.front().due <= Loop::now());
}

// What is told may call back, and close the port.
void FilterPort::run_in(When when) {
  while (reading_ && is_due(in_, when)) {
    const Step step = take(in_);
    let_inner_read();
    if (step.event) {
      step.event();
    } else {
      ForwardingPort::on_data(step.data);
    }
  }
  if (reading_ && !in_.steps.empty()) in_.timer.set(in_.steps.front().due);
}

void FilterPort::on_drained() {
  if (out_.steps.empty()) {
    ForwardingPort::on_drained();
  } else {
    run_out(When::due);
  }
}

void FilterPort::run_out(When when) {
  const bool was_congested = !out_.steps.empty();
  while (is_due(out_, when) && (when == When::now || !ForwardingPort::congested())) {
    ForwardingPort::write(take(out_).data);
  }
  if (!out_.steps.empty() && !ForwardingPort::congested()) out_.timer.set(out_.steps.front().due);
  if (was_congested && !congested()) ForwardingPort::on_drained();
}

}  // namespace porttape
