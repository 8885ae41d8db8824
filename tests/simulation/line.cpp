#include "tests/simulation/line.hpp"

#include <algorithm>
#include <utility>

#include "libport/base/line_settings_text.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// As the real ports have them.
constexpr Nanos kRestLimit = seconds(10);
constexpr Nanos kQuiet = seconds(2);
constexpr Nanos kLook = milliseconds(20);

LineDown down(LineDown::Reason reason, const std::string& name) {
  return {.reason = reason, .error = make_error(Errc::device_lost, name + " is gone")};
}

Bytes take(Bytes& from, std::size_t most) {
  const auto end = from.begin() + static_cast<std::ptrdiff_t>(std::min(most, from.size()));
  Bytes taken(from.begin(), end);
  from.erase(from.begin(), end);
  return taken;
}

}  // namespace

Line::Kind Line::Kind::of_driver(World& world) {
  return {.passive = true,
          .half_closes = world.chance(0.5),
          .knows_unread = world.chance(0.6),
          .capacity = static_cast<std::size_t>(world.between(1, 8192))};
}

Line::Kind Line::Kind::of_device(World& world) {
  return {.half_closes = world.chance(0.4),
          .always_open = world.chance(0.3),
          .capacity = static_cast<std::size_t>(world.between(1, 8192))};
}

void Line::open() {
  if (open_ || closing_) return;
  world_->trace("{}: the far end opens it", name_);
  open_ = true;
  ended_ = near_ended_ = false;
  to_near_.clear();
  to_far_.clear();
  set_.reset();
  if (port_ != nullptr) port_->soon();
}

void Line::close() {
  if (!open_) return;
  world_->trace("{}: the far end closes it, {} bytes unread, {} unsent", name_, to_far_.size(),
                to_near_.size());
  open_ = false;
  closing_ = port_ != nullptr && port_->up_;
  if (!closing_) to_near_.clear();
  if (port_ != nullptr) port_->soon();
}

std::size_t Line::send(ByteView data) {
  if (!open_ || ended_ || to_near_.size() >= kind_.capacity) return 0;
  const std::size_t size = std::min(data.size(), kind_.capacity - to_near_.size());
  to_near_.insert(to_near_.end(), data.begin(), data.begin() + static_cast<std::ptrdiff_t>(size));
  world_->trace("{}: the far end sends {} bytes", name_, size);
  if (port_ != nullptr) port_->soon();
  return size;
}

void Line::read(std::size_t most) {
  const Bytes came = take(to_far_, most);
  if (came.empty()) return;
  world_->trace("{}: the far end reads {} bytes", name_, came.size());
  on_read(came);
  if (port_ != nullptr) port_->soon();
}

void Line::half_close() {
  if (!open_ || ended_ || !kind_.half_closes) return;
  world_->trace("{}: the far end sends no more", name_);
  ended_ = true;
  if (port_ != nullptr) port_->soon();
}

void Line::flush_input() {
  if (!open_ || port_ == nullptr || !port_->up_ || to_far_.empty()) return;
  world_->trace("{}: the far end flushes {} bytes", name_, to_far_.size());
  to_far_.clear();
  port_->listener().on_flush(FlushQueue::in);
  port_->soon();
}

void Line::set(const SeenSettings& settings) {
  if (!open_) return;
  world_->trace("{}: the far end sets {}", name_, to_text(settings));
  set_ = settings;
  if (port_ != nullptr) port_->soon();
}

void Line::unplug() {
  if (!open_) return;
  world_->trace("{}: unplugged", name_);
  open_ = false;
  to_near_.clear();
  if (port_ == nullptr || !port_->up_) return;
  port_->drop_unsent();
  to_far_.clear();
  if (kind_.always_open) {
    port_->interrupted_ = true;
    port_->listener().on_interrupted(down(LineDown::Reason::lost, name_));
  } else {
    port_->go_down(LineDown::Reason::lost);
  }
}

void Line::plug_in() {
  if (open_) return;
  open();
  if (port_ != nullptr && std::exchange(port_->interrupted_, false)) port_->listener().on_resumed();
}

void Line::broken() {
  open_ = closing_ = false;
  on_broken();
}

LinePort::LinePort(World& world, Line& line)
    : world_(&world), line_(&line), timer_(world.loop(), [this] { look(); }) {
  line.port_ = this;
}

LinePort::~LinePort() {
  if (line_->port_ == this) line_->port_ = nullptr;
}

void LinePort::open() {
  world_->trace("{}: open()", line_->name_);
  accepting_ = true;
  if (passive()) return soon();
  if (line_->open_ || line_->kind_.always_open) {
    line_->near_ended_ = line_->ended_ = false;  // another connection
    up_ = true;
    interrupted_ = !line_->open_;
    listener().on_up();
    if (interrupted_) listener().on_interrupted(down(LineDown::Reason::lost, line_->name_));
    soon();
  } else {
    listener().on_down({.reason = LineDown::Reason::failed,
                        .error = make_error(Errc::device_lost, line_->name_ + " is not there")});
  }
}

void LinePort::close() {
  world_->trace("{}: close()", line_->name_);
  accepting_ = false;
  if (!std::exchange(up_, false)) return;
  drop_unsent();
  timer_.cancel();
  leaving_ = asked_ = interrupted_ = was_congested_ = false;
  answers_.reset();
  gone_since_.reset();
  const std::size_t rest = line_->to_near_.size();
  line_->to_near_.clear();
  if (rest > 0 && passive()) {
    line_->bytes_dropped += rest;
    listener().on_dropped(rest, "they were not read when the line was closed");
  }
  if (passive()) {
    line_->bytes_unread += unread_by_peer().value_or(0);
    line_->broken();
  } else if (!line_->to_far_.empty()) {
    line_->on_read(std::exchange(line_->to_far_, {}));  // the system still sends it
  }
}

void LinePort::drop_unsent() {
  const std::size_t most = line_->kind_.capacity;
  if (line_->to_far_.size() <= most) return;
  const std::size_t bytes = line_->to_far_.size() - most;
  line_->to_far_.resize(most);
  line_->bytes_dropped += bytes;
  listener().on_dropped(bytes, "they were not sent");
}

void LinePort::write(ByteView data) {
  line_->bytes_out += data.size();
  line_->passed.push_back({false, Bytes(data.begin(), data.end())});
  world_->trace("{}: write() of {} bytes", line_->name_, data.size());
  if (up_ && congested()) world_->wrong("{}: bytes are written to it while it is congested", line_->name_);
  if (interrupted_) world_->wrong("{}: bytes are written to it while it is interrupted", line_->name_);
  if (!up_ || interrupted_) {
    line_->bytes_dropped += data.size();
    listener().on_dropped(data.size(), "the line is not up");
    return;
  }
  line_->to_far_.insert(line_->to_far_.end(), data.begin(), data.end());
  was_congested_ = was_congested_ || congested();
  if (congested())
    line_->most_kept = std::max(line_->most_kept, line_->to_far_.size() - line_->kind_.capacity);
  quiet_since_ = world_->loop().now();
  line_->on_readable();
}

bool LinePort::end_writing() {
  world_->trace("{}: end_writing()", line_->name_);
  if (!line_->kind_.half_closes) return false;
  line_->near_ended_ = true;
  line_->on_readable();
  return true;
}

std::optional<std::size_t> LinePort::unread_by_peer() const {
  if (!line_->kind_.knows_unread) return std::nullopt;
  return line_->to_far_.size();
}

void LinePort::set_reading(bool on) {
  reading_ = on;
  if (on) soon();
}

void LinePort::hang_up(bool after_reading) {
  world_->trace("{}: hang_up({})", line_->name_, after_reading ? "after reading" : "at once");
  if (!up_) return;
  leaving_ = true;
  if (!after_reading) drop_unsent();
  if (!after_reading) line_->to_far_.clear();
  soon();
}

void LinePort::read_pending() {
  if (up_ && reading_) deliver(line_->to_near_.size());
}

void LinePort::soon() { timer_.set(world_->loop().now()); }

void LinePort::come_up() {
  up_ = true;
  was_congested_ = false;
  listener().on_up();
}

void LinePort::go_down(LineDown::Reason reason) {
  up_ = leaving_ = asked_ = interrupted_ = was_congested_ = false;
  answers_.reset();
  gone_since_.reset();
  line_->closing_ = false;
  if (!line_->to_near_.empty()) {
    line_->bytes_dropped += line_->to_near_.size();
    const std::size_t rest = std::exchange(line_->to_near_, {}).size();
    listener().on_dropped(rest, "the line ended before them");
  }
  if (passive()) line_->broken();
  listener().on_down(down(reason, line_->name_));
}

void LinePort::deliver(std::size_t most) {
  const Bytes data = take(line_->to_near_, most);
  if (data.empty()) return;
  world_->trace("{}: on_data() of {} bytes", line_->name_, data.size());
  line_->bytes_in += data.size();
  line_->passed.push_back({true, data});
  listener().on_data(data);
}

// One thing a turn, as a port on the loop does.
void LinePort::look() {
  if (!up_) {
    if (accepting_ && passive() && line_->open_) {
      come_up();
      soon();
    }
    return;
  }
  if (line_->set_) {
    soon();
    return listener().on_settings(*std::exchange(line_->set_, std::nullopt), SettingsOrder::sampled);
  }
  if (was_congested_ && !congested()) {
    was_congested_ = false;
    soon();
    return listener().on_drained();
  }
  if (leaving_) {
    if (!line_->open_) drop_unsent();
    if (line_->to_far_.empty() || !line_->open_) go_down(LineDown::Reason::hung_up);
    return;
  }
  if (reading_ && !line_->to_near_.empty()) {
    soon();
    return deliver(static_cast<std::size_t>(world_->between(1, 4096)));
  }
  const bool gone = !line_->open_ && !interrupted_;
  if (gone) {
    drop_unsent();
    if (!gone_since_) gone_since_ = world_->loop().now();
    const bool kept = !line_->to_near_.empty() && listener().wants_rest() &&
                      world_->loop().now() - *gone_since_ < kRestLimit;
    if (kept) return timer_.set_after(kLook);
    return go_down(LineDown::Reason::closed);
  }
  if (line_->ended_ && line_->to_near_.empty()) {
    if (!std::exchange(asked_, true)) {
      quiet_since_ = world_->loop().now();
      answers_ = listener().on_ended();
      if (!up_) return;
      if (*answers_ == PortListener::Answers::none) {
        drop_unsent();
        return go_down(LineDown::Reason::closed);
      }
    }
    const bool ends = answers_ == PortListener::Answers::until_it_is_quiet;
    if (ends && !congested() && world_->loop().now() - quiet_since_ >= kQuiet)
      return go_down(LineDown::Reason::closed);
    if (ends) timer_.set_after(kLook);
  }
}

}  // namespace porttape::simulation
