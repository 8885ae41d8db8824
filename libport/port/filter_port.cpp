#include "libport/port/filter_port.hpp"

#include <chrono>
#include <utility>

namespace porttape {
namespace {

// As long as a StreamLine whose peer is gone waits to be read.
constexpr Nanos kRestLimit = std::chrono::seconds(10);
constexpr Instant kNotAtAll{};

}  // namespace

FilterPort::FilterPort(const PortContext& context, std::unique_ptr<Port> inner)
    : ForwardingPort(std::move(inner)),
      loop_(context.loop),
      in_(*context.loop,
          {.open = [this] { return reading_; },
           .pass = [this](ByteView data) { pass(data); },
           .given_up = [this](std::size_t bytes) { drop(bytes, "nobody read them before the line broke"); },
           .less = [this] { let_inner_read(); }}),
      out_(*context.loop, {.open = [this] { return !interrupted_ && !ForwardingPort::congested(); },
                           .pass = [this](ByteView data) { ForwardingPort::write(data); },
                           .given_up = [this](std::size_t bytes) { drop(bytes, "they could not be sent"); },
                           .less =
                               [this] {
                                 if (!congested()) ForwardingPort::on_drained();
                               }}) {}

void FilterPort::close() {
  pass_together();
  ++closes_;
  ForwardingPort::close();
  drop_writes("they were held back when the line was closed");
  drop_held(in_, "they were held back when the line was closed");
  let_inner_read();
}

void FilterPort::finish() {
  drop_writes("they were held back at the end");
  drop_held(in_, "they were held back at the end");
  ForwardingPort::finish();
}

void FilterPort::drop_held(Lane& lane, std::string_view why) {
  if (const std::size_t bytes = lane.drop(); bytes > 0) lose_held(bytes, why);
}

// An end that waits behind them goes with them.
void FilterPort::drop_writes(std::string_view why) {
  end_ = nullptr;
  drop_held(out_, why);
}

void FilterPort::deliver(ByteView arrival, Instant due) {
  in_.put(arrival, due);
  let_inner_read();
}

void FilterPort::on_arrivals(ByteView data, std::span<const std::size_t> ends) {
  const unsigned session = closes_;
  together_.emplace();
  for_each_arrival(data, ends, [&](ByteView arrival) {
    if (session == closes_) {
      incoming(arrival);
    } else {
      lose_held(arrival.size(), "the line was closed before them");
    }
  });
  pass_together();
}

void FilterPort::pass(ByteView data) {
  if (!together_) return ForwardingPort::on_data(data);
  together_->data.insert(together_->data.end(), data.begin(), data.end());
  together_->ends.push_back(together_->data.size());
}

void FilterPort::pass_together() {
  const std::optional<Together> all = std::exchange(together_, std::nullopt);
  if (all && !all->ends.empty()) ForwardingPort::on_arrivals(all->data, all->ends);
}

void FilterPort::set_reading(bool on) {
  reading_ = on;
  inner_reads_ = on && in_.bytes() < kMostWaiting;
  ForwardingPort::set_reading(inner_reads_);
  in_.arm();
}

void FilterPort::let_inner_read() {
  const bool on = reading_ && in_.bytes() < kMostWaiting;
  if (on != std::exchange(inner_reads_, on)) ForwardingPort::set_reading(on);
}

void FilterPort::read_pending() {
  in_.hurry(true);
  ForwardingPort::read_pending();
  in_.hurry(false);
}

void FilterPort::on_up() {
  interrupted_ = false;
  const auto tell = [this, session = closes_] {
    if (session == closes_) ForwardingPort::on_up();
  };
  in_.put(tell, kNotAtAll);
}

void FilterPort::on_down(const LineDown& down) {
  interrupted_ = false;
  drop_writes("they were held back when the line went down");
  ++downs_untold_;
  const auto tell = [this, down, session = closes_] {
    --downs_untold_;
    if (session == closes_) ForwardingPort::on_down(down);
  };
  in_.put(tell, down.reason == LineDown::Reason::closed ? now() + kRestLimit : kNotAtAll);
}

void FilterPort::on_interrupted(const LineDown& down) {
  interrupted_ = true;
  in_.put([this, down] { ForwardingPort::on_interrupted(down); }, kNotAtAll);
}

void FilterPort::on_resumed() {
  interrupted_ = false;
  in_.put([this] { ForwardingPort::on_resumed(); }, kNotAtAll);
  out_.run();
}

void FilterPort::told(const LineEvent& event) {
  if (!keeps_place(event)) return ForwardingPort::told(event);
  in_.put([this, event] { ForwardingPort::told(event); });
}

// A replay that is over has its last bytes behind what is held; a tape that must not fail has no time.
void FilterPort::on_finished(int exit_status) {
  if (exit_status == exit_status::kRuntime) return ForwardingPort::on_finished(exit_status);
  in_.put([this, exit_status] { ForwardingPort::on_finished(exit_status); }, now() + kRestLimit);
}

PortListener::Answers FilterPort::on_ended() {
  const unsigned session = closes_;
  in_.let_go();
  if (session != closes_) return Answers::none;
  if (in_.empty()) return ForwardingPort::on_ended();
  in_.put([this, session] {
    if (session == closes_) (void)ForwardingPort::on_ended();
  });
  return Answers::until_it_is_quiet;
}

// Asked while the inner port is not read: if only for what is held, it soon will be.
bool FilterPort::wants_rest() { return reading_ || ForwardingPort::wants_rest(); }

void FilterPort::send(ByteView data, Instant due) {
  if (downs_untold_ > 0) return drop(data.size(), "the line had gone down");
  out_.put(data, due);
}

void FilterPort::tell(const LineEvent& event) {
  if (!keeps_place(event)) return ForwardingPort::tell(event);
  out_.put([this, event] { ForwardingPort::tell(event); });
}

void FilterPort::on_drained() {
  if (out_.empty()) {
    ForwardingPort::on_drained();
  } else {
    out_.run();
  }
}

bool FilterPort::end_writing() {
  out_.let_go();
  if (out_.empty()) return ForwardingPort::end_writing();
  end_behind_writes([this] { (void)ForwardingPort::end_writing(); });
  return has_half_close();
}

void FilterPort::hang_up(bool after_reading) {
  out_.let_go();
  if (after_reading && !out_.empty()) {
    return end_behind_writes([this] { ForwardingPort::hang_up(true); });
  }
  drop_writes("they were held back when the line was hung up");
  ForwardingPort::hang_up(after_reading);
}

// One at a time: the last that is asked for is the one, at the place of the first.
void FilterPort::end_behind_writes(std::function<void()> end) {
  end_ = std::move(end);
  out_.put([this] {
    if (const auto due = std::exchange(end_, nullptr)) due();
  });
}

std::optional<LineSettings> FilterPort::settings() const {
  if (!settings_waiting_.empty()) return settings_waiting_.back();
  return ForwardingPort::settings();
}

Result<void> FilterPort::apply(const LineSettings& settings) {
  out_.let_go();
  if (out_.empty() || !ForwardingPort::settings()) return ForwardingPort::apply(settings);
  settings_waiting_.push_back(settings);
  out_.put([this] { apply_waiting(); });
  return {};
}

void FilterPort::apply_waiting() {
  const LineSettings settings = settings_waiting_.front();
  settings_waiting_.pop_front();
  if (ForwardingPort::apply(settings)) return;
  if (const std::optional<LineSettings> kept = this->settings())
    ForwardingPort::told(line::Settings{SeenSettings::of(*kept)});
}

std::optional<std::size_t> FilterPort::unread_by_peer() const {
  const std::optional<std::size_t> unread = ForwardingPort::unread_by_peer();
  return unread ? std::optional(*unread + out_.bytes()) : std::nullopt;
}

std::optional<std::size_t> FilterPort::unread() const {
  const std::optional<std::size_t> unread = ForwardingPort::unread();
  return unread ? std::optional(*unread + in_.bytes()) : std::nullopt;
}

std::size_t FilterPort::write_some(ByteView data) {
  if (congested()) return 0;
  outgoing(data);
  return data.size();
}

bool FilterPort::discard() {
  if (!ForwardingPort::discard()) return false;
  for (Lane* lane : {&out_, &in_}) lane->drop();
  let_inner_read();
  return true;
}

std::optional<Instant> FilterPort::next_due() {
  std::optional<Instant> next = ForwardingPort::next_due();
  for (const Lane* lane : {&in_, &out_}) {
    const std::optional<Instant> due = lane->next_due();
    if (due && (!next || *due < *next)) next = due;
  }
  return next;
}

}  // namespace porttape
