#include "libport/taped/tap_port.hpp"

#include <algorithm>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {

// What passes in one call, with where each arrival ends; one block where that is not said. The views are
// valid until the port is called again.
struct TapPort::Blocks {
  Direction direction;
  Instant at;
  ByteView data;
  std::span<const std::size_t> ends = {};
};

TapPort::TapPort(const PortContext& context, std::unique_ptr<Port> inner, Nanos end_limit)
    : ForwardingPort(std::move(inner)),
      log_(context.log),
      loop_(context.loop),
      end_timer_(*context.loop,
                 [this] {
                   give_up_observers();
                   complete_if_over();
                 }),
      end_limit_(end_limit) {}

TapPort::~TapPort() {
  give_up_observers();
  tell_late();
}

void TapPort::add(std::unique_ptr<LineObserver> observer) { observers_.push_back({std::move(observer)}); }

void TapPort::must_end() {
  tell_passed();
  listener().on_finished(exit_status::kRuntime);
}

Result<void> TapPort::prepare() {
  for (const auto& observer : observers_) {
    if (Result<void> ready = observer->check(); !ready) return ready;
  }
  return ForwardingPort::prepare();
}

void TapPort::open() {
  tell_passed();
  open_ = true;
  writing_ended_ = false;
  repeats_.begin_session();
  tell_observers([now = loop_->now()](LineObserver& observer) { observer.opened(now); });
  ForwardingPort::open();
}

void TapPort::on_up() {
  tell_observers([now = loop_->now()](LineObserver& observer) { observer.came_up(now); });
  note_device_settings();
  ForwardingPort::on_up();
}

void TapPort::close() {
  tell_passed();
  drains_.clear();  // one that only the end of the line has ended was none
  ForwardingPort::close();
  if (!std::exchange(open_, false)) return;
  tell_observers([now = loop_->now()](LineObserver& observer) { observer.closed(now); });
}

// The time is that before it goes out: the answer must not be stamped earlier.
void TapPort::write(ByteView data) {
  pass({Direction::write, loop_->now(), data}, [&] { ForwardingPort::write(data); });
}

// How much of it passes is known afterwards alone.
std::size_t TapPort::write_some(ByteView data) {
  tell_passed();
  const Instant at = loop_->now();
  const std::size_t sent = ForwardingPort::write_some(data);
  tell_blocks({Direction::write, at, data.first(sent)});
  return sent;
}

bool TapPort::discard() {
  tell_passed();
  const bool dropped = ForwardingPort::discard();
  if (dropped) note_line({Side::driver, line::Flush{FlushQueue::both}});
  return dropped;
}

bool TapPort::end_writing() {
  tell_passed();
  writing_ended_ = true;
  note(event::HalfClose{Side::driver});
  return ForwardingPort::end_writing();
}

void TapPort::set_reading(bool on) {
  if (on) tell_passed();
  ForwardingPort::set_reading(on);
}

void TapPort::hang_up(bool after_reading) {
  tell_passed();
  ForwardingPort::hang_up(after_reading);
}

void TapPort::read_pending() {
  tell_passed();
  ForwardingPort::read_pending();
}

void TapPort::tell(const LineEvent& event) {
  tell_passed();
  const auto* const drain = std::get_if<line::Drain>(&event);
  if (drain != nullptr && open_) drains_.emplace(drain->number, loop_->now());
  // What the driver's line shows of the device's signals is not the driver's.
  const auto* const signal = std::get_if<LineSignal>(&event);
  const bool shown = signal != nullptr && !is_output(signal->name) && signal->name != LineSignal::Name::brk;
  note_line({shown ? Side::device : Side::driver, event});
  ForwardingPort::tell(event);
}

void TapPort::told(const LineEvent& event) {
  if (const auto* const sent = std::get_if<line::Sent>(&event)) {
    if (const auto drain = drains_.extract(sent->number))
      note(event::Drain{std::chrono::duration_cast<Micros>(loop_->now() - drain.mapped())});
  }
  note_line({Side::device, event});
  ForwardingPort::told(event);
}

// A device that refuses has settings that the driver did not ask for.
Result<void> TapPort::apply(const LineSettings& settings) {
  tell_passed();
  Result<void> applied = ForwardingPort::apply(settings);
  if (!applied && open_) note_device_settings();
  return applied;
}

void TapPort::note_gap(std::uint64_t bytes, std::string_view why) {
  note_line({Side::device, line::Dropped{bytes, why}});
}

void TapPort::on_data(ByteView data) {
  pass({Direction::read, loop_->now(), data}, [&] { ForwardingPort::on_data(data); });
}

// Each arrival is a block of its own.
void TapPort::on_arrivals(ByteView data, std::span<const std::size_t> ends) {
  pass({Direction::read, loop_->now(), data, ends}, [&] { ForwardingPort::on_arrivals(data, ends); });
}

void TapPort::on_down(const LineDown& down) {
  // A device that listens waits for its next peer, and the driver's line stays; one that ends when the driver
  // has ended has not left it.
  const bool left = !passive() && !(writing_ended_ && down.reason == LineDown::Reason::closed);
  if (left) note_lost(down, true);
  ForwardingPort::on_down(down);
}

PortListener::Answers TapPort::on_ended() {
  // Of a device that connects the driver is not told: another one may follow, on the same line.
  if (!passive()) note(event::HalfClose{Side::device});
  return ForwardingPort::on_ended();
}

void TapPort::on_interrupted(const LineDown& down) {
  note_lost(down, false);
  ForwardingPort::on_interrupted(down);
}

void TapPort::on_resumed() {
  note(event::DeviceBack{});
  note_device_settings();
  ForwardingPort::on_resumed();
}

Result<void> TapPort::request(const RecorderRequest& what) {
  bool taken = false;
  std::optional<Error> refused;
  tell_observers([&, now = loop_->now()](LineObserver& observer) {
    const Result<bool> answer = observer.request(now, what);
    if (answer) {
      taken = taken || *answer;
    } else if (!refused) {
      refused = answer.error();
    }
  });
  if (taken) return {};
  return refused ? *refused : make_error(Errc::usage, name() + ": its recording has ended");
}

std::optional<RecordingStatus> TapPort::recording() const {
  for (const Observer& each : observers_) {
    if (auto status = each->recording()) return status;
  }
  return std::nullopt;
}

void TapPort::finish() {
  close();
  ForwardingPort::finish();
}

void TapPort::on_complete(int exit_status) {
  tell_passed();
  exit_status_ = exit_status;
  const Instant now = loop_->now();
  over_ = true;
  end_timer_.set_after(end_limit_);
  for (Observer& each : observers_) {
    each->finish(now, [this, &each](bool complete) {
      if (each.finished) return;  // was given up
      observer_finished(each, complete);
      complete_if_over();
    });
  }
  finishing_ = true;
  complete_if_over();
}

void TapPort::observer_finished(Observer& observer, bool complete) {
  observer.finished = true;
  if (!complete && exit_status_ == 0) exit_status_ = exit_status::kRuntime;
}

void TapPort::give_up_observers() {
  for (Observer& each : observers_) {
    if (each.finished) continue;
    observer_finished(each, false);
    each->give_up();
  }
}

void TapPort::complete_if_over() {
  if (!finishing_ || !std::ranges::all_of(observers_, &Observer::finished)) return;
  finishing_ = false;
  end_timer_.cancel();
  if (tell_late() && exit_status_ == 0) exit_status_ = exit_status::kRuntime;
  ForwardingPort::on_complete(exit_status_);
}

// The observers have finished: too late for them.
bool TapPort::tell_late() {
  if (late_bytes_ == 0) return false;
  log_->error("{}: {} bytes came after the end of its recording and are not in it", ForwardingPort::name(),
              late_bytes_);
  late_bytes_ = 0;
  return true;
}

// Passes them on, and tells of them after that, or as soon as there is something else to tell or the views
// may end: what they are in the middle of began sooner.
template <class PassOn>
void TapPort::pass(const Blocks& blocks, const PassOn& pass_on) {
  tell_passed();
  passing_ = &blocks;
  try {
    pass_on();
  } catch (...) {
    passing_ = nullptr;
    throw;
  }
  if (passing_ == &blocks) tell_passed();
}

void TapPort::tell_passed() {
  if (const Blocks* const blocks = std::exchange(passing_, nullptr)) tell_blocks(*blocks);
}

template <class Tell>
void TapPort::tell_observers(const Tell& what) {
  tell_passed();
  if (over_) return;
  for (const Observer& each : observers_) what(*each.observer);
}

void TapPort::tell_blocks(const Blocks& blocks) {
  if (!blocks.data.empty()) repeats_.on_bytes();
  if (over_) late_bytes_ += blocks.data.size();
  tell_observers([&blocks](LineObserver& observer) {
    const auto tell_block = [&](ByteView data) {
      if (!data.empty()) observer.block(blocks.direction, blocks.at, data);
    };
    if (blocks.ends.empty()) {
      tell_block(blocks.data);
    } else {
      for_each_arrival(blocks.data, blocks.ends, tell_block);
    }
  });
}

void TapPort::note(const Event& event) {
  tell_observers([now = loop_->now(), event](LineObserver& observer) { observer.note(now, event); });
}

void TapPort::note_line(const TapedLineEvent& event) {
  const std::optional<Event> taped = event_of(event);
  if (!taped) return;
  tell_passed();
  if (repeats_.is_new(event, loop_->now())) note(*taped);
}

void TapPort::note_device_settings() {
  if (const auto own = settings()) note_line({Side::device, line::Settings{SeenSettings::of(*own)}});
}

void TapPort::note_lost(const LineDown& down, bool hung_up) {
  note(event::DeviceLost{down.error.message, hung_up});
}

}  // namespace porttape
