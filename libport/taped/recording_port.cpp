#include "libport/taped/recording_port.hpp"

#include <array>
#include <string_view>
#include <utility>

namespace porttape {

RecordingPort::RecordingPort(const PortContext& context, std::unique_ptr<Port> inner, Options options)
    : inner_(std::move(inner)),
      replaces_(options.tape.on_existing == OnExisting::overwrite),
      now_(options.now),
      keeper_(context, std::move(options.tape), [this] { listener().on_finished(exit_status::kRuntime); }) {}

void RecordingPort::listen(PortListener& listener) {
  Port::listen(listener);
  inner_->listen(*this);
}

Result<void> RecordingPort::prepare() {
  if (Result<void> free = keeper_.check(); !free) return free;
  return inner_->prepare();
}

void RecordingPort::open() {
  open_ = true;
  writing_ended_ = false;
  const Instant now = now_();
  if (keeper_.begun()) {
    keeper_.opened(now);
  } else {
    zero_ = now;
    if (!replaces_) begin_tape();
  }
  inner_->open();
}

// A tape that replaces another is made only when the line is up: a device that cannot be opened costs
// nothing.
void RecordingPort::on_up() {
  if (open_ && !keeper_.begun()) begin_tape();
  listener().on_up();
}

void RecordingPort::begin_tape() {
  keeper_.begin(zero_);
  keeper_.opened(zero_);
}

void RecordingPort::close() {
  inner_->close();
  if (open_) keeper_.closed(now_());
  open_ = false;
}

void RecordingPort::write(ByteView data) {
  const Instant at = now_();  // before it goes out: the answer must not be stamped earlier
  inner_->write(data);
  keeper_.block(Direction::write, at, data);
}

std::size_t RecordingPort::write_some(ByteView data) {
  const Instant at = now_();
  const std::size_t sent = inner_->write_some(data);
  keeper_.block(Direction::write, at, data.first(sent));
  return sent;
}

bool RecordingPort::end_writing() {
  writing_ended_ = true;
  keeper_.note(now_(), event::HalfClose{Side::driver});
  return inner_->end_writing();
}

void RecordingPort::note_gap(std::uint64_t bytes, std::string_view why) {
  keeper_.note(now_(), event::Gap{bytes, std::nullopt, std::string(why)});
}

void RecordingPort::note_flush(FlushQueue queue) {
  using Queue = event::Flush::Queue;
  constexpr std::array<Queue, 3> queues = {Queue::in, Queue::out, Queue::both};
  keeper_.note(now_(), event::Flush{queues.at(static_cast<std::size_t>(queue))});
}

void RecordingPort::peer_flushed(FlushQueue queue) {
  note_flush(queue);
  inner_->peer_flushed(queue);
}

bool RecordingPort::discard() {
  const bool dropped = inner_->discard();
  if (dropped) note_flush(FlushQueue::both);
  return dropped;
}

void RecordingPort::on_data(ByteView data) {
  const Instant at = now_();
  listener().on_data(data);
  keeper_.block(Direction::read, at, data);
}

void RecordingPort::note_lost(const LineDown& down, bool hung_up) {
  keeper_.note(now_(), event::DeviceLost{down.error.message, hung_up});
}

void RecordingPort::on_down(const LineDown& down) {
  // A device that listens waits for its next peer, and the driver's line stays; one that ends when the driver
  // has ended has not left it.
  const bool left = !inner_->passive() && !(writing_ended_ && down.reason == LineDown::Reason::closed);
  if (left) note_lost(down, true);
  listener().on_down(down);
}

PortListener::Answers RecordingPort::on_ended() {
  keeper_.note(now_(), event::HalfClose{Side::device});
  return listener().on_ended();
}

void RecordingPort::on_interrupted(const LineDown& down) {
  note_lost(down, false);
  listener().on_interrupted(down);
}

void RecordingPort::on_resumed() {
  keeper_.note(now_(), event::DeviceBack{});
  listener().on_resumed();
}

void RecordingPort::on_dropped(std::uint64_t bytes, std::string_view why) {
  note_gap(bytes, why);
  listener().on_dropped(bytes, why);
}

void RecordingPort::rotate() { keeper_.rotate(now_()); }

void RecordingPort::finish() {
  close();
  inner_->finish();
}

void RecordingPort::on_complete(int exit_status) {
  keeper_.finish(now_(), [this, exit_status](bool complete) {
    listener().on_complete(exit_status != 0 || complete ? exit_status : exit_status::kRuntime);
  });
}

}  // namespace porttape
