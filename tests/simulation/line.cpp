#include "tests/simulation/line.hpp"

#include <algorithm>
#include <utility>

#include "libport/line/line_settings_text.hpp"
#include "tests/simulation/line_port.hpp"

namespace porttape::simulation {
namespace {

using What = Passed::What;

std::string_view state_of(const LineSignal& signal) { return signal.on ? "on" : "off"; }

}  // namespace

std::string_view name_of(FlushQueue queue) {
  switch (queue) {
    case FlushQueue::in:
      return "in";
    case FlushQueue::out:
      return "out";
    case FlushQueue::both:
      break;
  }
  return "both";
}

Line::Kind Line::Kind::of_driver(World& world) {
  return {.passive = true,
          .half_closes = world.chance(0.5),
          .knows_unread = world.chance(0.6),
          .capacity = static_cast<std::size_t>(world.between(1, 8192))};
}

Line::Kind Line::Kind::of_device(World& world) {
  return {.is_device = true,
          .half_closes = world.chance(0.4),
          .always_open = world.chance(0.3),
          .capacity = static_cast<std::size_t>(world.between(1, 8192))};
}

void Line::open() {
  if (open_ || closing_) return;
  world_->trace("{}: the far end opens it", name_);
  open_ = true;
  ended_ = near_ended_ = false;
  forget_acts();
  to_near_.clear();
  to_far_.clear();
  set_.reset();
  unseen_settings_ = false;
  if (port_ != nullptr) port_->soon();
}

bool Line::is_up() const { return open_ && port_ != nullptr && port_->up_; }

void Line::close() {
  if (!open_) return;
  if (kind_.always_open) return lose(false);  // its port waits for it to come back
  world_->trace("{}: the far end closes it, {} bytes unread, {} unsent", name_, unread(), unsent());
  open_ = false;
  closing_ = port_ != nullptr && port_->up_;
  if (!closing_) {
    forget_acts();
    to_near_.clear();
  }
  if (port_ != nullptr) port_->soon();
}

std::size_t Line::send(ByteView data) {
  if (!open_ || ended_ || unsent() >= kind_.capacity) return 0;
  const std::size_t size = kind_.datagrams ? data.size() : std::min(data.size(), kind_.capacity - unsent());
  to_near_.put(data.first(size));
  world_->trace("{}: the far end sends {} bytes", name_, size);
  if (port_ != nullptr) port_->soon();
  return size;
}

void Line::read(std::size_t most) {
  bool any = false;
  while (most > 0) {
    const Bytes came = to_far_.take(most);
    if (came.empty()) break;
    any = true;
    last_read = world_->loop().now();
    most -= std::min(most, came.size());
    world_->trace("{}: the far end reads {} bytes", name_, came.size());
    on_read(came);
    reach_acts();
  }
  if (any && port_ != nullptr) port_->soon();
}

// Shows the far end each act that precedes its next byte.
void Line::reach_acts() {
  while (to_far_.act_is_first()) {
    const std::optional<Passed> act = to_far_.take_act();
    if (act->what == What::signal) {
      world_->trace("{}: the far end sees {} {}", name_, porttape::name_of(act->signal.name),
                    state_of(act->signal));
      on_signal(act->signal);
    } else if (act->what == What::settings) {
      const LineSettings made = act->settings.over(settings_);
      if (port_ != nullptr && port_->up_)
        settings_ = made;  // what a line's end has left over is not the next one's
      world_->trace("{}: the far end's line is {}", name_, to_text(act->settings));
      on_settings(made);
    }
    if (port_ != nullptr) port_->reached(*act);
  }
}

void Line::half_close() {
  if (!open_ || ended_ || !kind_.half_closes) return;
  world_->trace("{}: the far end sends no more", name_);
  ended_ = true;
  if (port_ != nullptr) port_->soon();
}

void Line::flush(FlushQueue queue) {
  if (!open_ || kind_.datagrams || port_ == nullptr || !port_->up_) return;
  if (kind_.supervised) return put_act({.to_listener = true, .what = What::flush, .queue = queue});
  const bool drops_in = queue != FlushQueue::out && unread() > 0;
  const bool drops_out = queue != FlushQueue::in && unsent() > 0;
  if (!drops_in && !drops_out) return;
  world_->trace("{}: the far end flushes {}: {} bytes unread, {} unsent", name_, name_of(queue), unread(),
                unsent());
  if (drops_in) (void)to_far_.keep(0);
  if (drops_out) (void)to_near_.keep(0);
  port_->tell_act({.to_listener = true, .what = What::flush, .queue = queue});
  port_->soon();
}

void Line::set(const SeenSettings& settings) {
  if (!open_) return;
  world_->trace("{}: the far end sets {}", name_, to_text(settings));
  settings_ = settings.over(settings_);
  unseen_settings_ = true;
  if (kind_.supervised) return put_act({.to_listener = true, .what = What::settings, .settings = settings});
  set_ = settings;
  if (port_ != nullptr) port_->soon();
}

void Line::signal(const LineSignal& signal) {
  if (!kind_.passive) signals_[signal.name] = signal.on;
  if (!open_ || !(kind_.supervised || kind_.serial)) return;
  world_->trace("{}: the far end turns {} {}", name_, porttape::name_of(signal.name), state_of(signal));
  put_act({.to_listener = true, .what = What::signal, .signal = signal});
}

void Line::drain(std::function<void()> done) {
  if (!open_ || !kind_.supervised) return done();
  const std::uint64_t number = world_->next_number();
  world_->trace("{}: the far end drains it, no. {}", name_, number);
  drains_[number] = std::move(done);
  put_act({.to_listener = true, .what = What::drain, .number = number});
}

void Line::ask(const LineRequest& request, TakeAnswer done) {
  if (!open_ || !kind_.supervised) return done(std::nullopt);
  const std::uint64_t number = world_->next_number();
  world_->trace("{}: the far end asks, no. {}", name_, number);
  questions_[number] = std::move(done);
  put_act({.to_listener = true, .what = What::ask, .number = number, .request = request});
}

void Line::put_act(Passed act) {
  act.at = world_->loop().now();
  to_near_.put(std::move(act));
  if (port_ != nullptr) port_->soon();
}

// The line is over: acts that the near end has not learnt of are dropped, and their callers get an answer.
void Line::forget_acts() {
  while (const std::optional<Passed> act = to_near_.take_act()) {
    if (const auto drain = drains_.extract(act->number)) drain.mapped()();
    if (const auto question = questions_.extract(act->number)) question.mapped()(std::nullopt);
  }
}

void Line::unplug() { lose(false); }

void Line::lose(bool after_reading) {
  if (!open_) return;
  world_->trace("{}: {}", name_, after_reading ? "unplugged, once all is read" : "unplugged");
  open_ = false;
  forget_acts();
  to_near_.clear();
  if (port_ == nullptr || (!port_->up_ && !kind_.always_open)) return;
  port_->drop_unsent();
  to_far_.clear();
  port_->answer_all();
  if (kind_.always_open) {
    if (port_->prepared_) port_->interrupt();
  } else {
    port_->go_down(LineDown::Reason::lost, after_reading);
  }
}

void Line::plug_in() {
  if (open_) return;
  open();
  if (port_ != nullptr) port_->resume();
}

void Line::broken() {
  open_ = closing_ = false;
  on_broken();
}

void Line::drained(std::uint64_t number) {
  told_.erase(number);
  const auto drain = drains_.extract(number);
  if (!drain) return world_->wrong("{}: drain no. {} is answered again", name_, number);
  world_->trace("{}: the far end has no. {} drained", name_, number);
  passed.push_back(
      {.what = What::drained, .number = number, .at = world_->loop().now(), .serial = world_->next_number()});
  drain.mapped()();
}

void Line::answered(std::uint64_t number, const std::optional<LineAnswer>& answer) {
  told_.erase(number);
  const auto question = questions_.extract(number);
  if (!question) return world_->wrong("{}: question no. {} is answered again", name_, number);
  world_->trace("{}: the far end has no. {} answered: {}", name_, number,
                answer ? std::to_string(answer->error) : "there is no device to ask");
  passed.push_back({.what = What::answered,
                    .number = number,
                    .at = world_->loop().now(),
                    .serial = world_->next_number()});
  question.mapped()(answer);
}

}  // namespace porttape::simulation
