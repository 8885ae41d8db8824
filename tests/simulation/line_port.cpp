#include "tests/simulation/line_port.hpp"

#include <algorithm>
#include <cerrno>
#include <utility>

#include "libport/line/line_settings_text.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using What = Passed::What;

// As the real ports have them.
constexpr Nanos kRestLimit = seconds(10);
constexpr Nanos kQuiet = seconds(2);
constexpr Nanos kLook = milliseconds(20);
constexpr Nanos kCatchUpLimit = seconds(5);
// A device's answer to a question takes up to so long.
constexpr Nanos kLongestAnswer = seconds(2);

std::string_view state_text(const LineSignal& signal) { return signal.on ? "on" : "off"; }

}  // namespace

LinePort::LinePort(World& world, Line& line)
    : world_(&world), line_(&line), timer_(world.loop(), [this] { look(); }) {
  line.port_ = this;
}

LinePort::~LinePort() {
  if (line_->port_ == this) line_->port_ = nullptr;
}

void LinePort::log(Passed what) {
  what.at = world_->loop().now();
  what.serial = world_->next_number();
  line_->passed.push_back(std::move(what));
}

// With the settings that the line has then.
void LinePort::log_device(Passed::What what) {
  log({.to_listener = true, .what = what, .settings = SeenSettings::of(settings().value_or(LineSettings{}))});
}

LineDown LinePort::down(LineDown::Reason reason, bool after_reading) const {
  return {.reason = reason,
          .error = make_error(Errc::device_lost, line_->name_ + " is gone"),
          .after_reading = after_reading};
}

Result<void> LinePort::prepare() {
  prepared_ = true;
  log(What::prepare, false);
  line_->on_prepare();
  if (line_->kind_.always_open && !line_->open_) interrupt();
  return {};
}

void LinePort::open() {
  world_->trace("{}: open()", line_->name_);
  log(What::open, false);
  line_->on_open();
  accepting_ = true;
  if (passive() || interrupted_) return soon();
  if (line_->open_) {
    line_->near_ended_ = line_->ended_ = false;  // another connection
    come_up();
    soon();
  } else {
    log({.to_listener = true, .what = What::down, .reason = LineDown::Reason::failed});
    listener().on_down({.reason = LineDown::Reason::failed,
                        .error = make_error(Errc::device_lost, line_->name_ + " is not there")});
  }
}

void LinePort::close() {
  world_->trace("{}: close()", line_->name_);
  if (std::exchange(accepting_, false)) log(What::close, false);
  untried_.reset();
  leave();
  line_->forget_acts();                                          // of a line that was lost before
  if (!passive() && line_->kind_.serial) line_->settings_ = {};  // the user's own
  asked_for_.reset();
}

void LinePort::leave() {
  if (!std::exchange(up_, false)) return;
  if (congested() && line_->open_ && !interrupted_) line_->on_cut(line_->unread() - line_->kind_.capacity);
  drop_unsent();
  timer_.cancel();
  leaving_ = asked_ = was_congested_ = false;
  answers_.reset();
  rest_wait_.reset();
  line_->forget_acts();
  const std::size_t rest = line_->unsent();
  if (!line_->kind_.always_open) line_->to_near_.clear();
  if (line_->kind_.always_open) soon();
  if (rest > 0 && !line_->kind_.is_device) {
    line_->bytes_dropped += rest;
    listener().told(line::Dropped{rest, "they were not read when the line was closed"});
  }
  if (!line_->kind_.is_device) {
    line_->bytes_unread += unread_by_peer().value_or(0);
    line_->broken();
  } else {
    answer_all();
    line_->reach_acts();
    line_->read(line_->unread());  // the system still sends it
    if (passive()) line_->broken();
  }
  asked_for_.reset();
}

void LinePort::drop_unsent() {
  const std::size_t bytes = line_->to_far_.keep(line_->kind_.capacity);
  if (bytes == 0) return;
  line_->bytes_dropped += bytes;
  listener().told(line::Dropped{bytes, "they were not sent"});
}

void LinePort::write(ByteView data) {
  line_->bytes_out += data.size();
  log({.data = Bytes(data.begin(), data.end())});
  world_->trace("{}: write() of {} bytes", line_->name_, data.size());
  if (up_ && congested() && !keeps_datagrams())
    world_->wrong("{}: bytes are written to it while it is congested", line_->name_);
  if (interrupted_) world_->wrong("{}: bytes are written to it while it is interrupted", line_->name_);
  if (!up_ || interrupted_) {
    line_->bytes_dropped += data.size();
    listener().told(line::Dropped{data.size(), "the line is not up"});
    return;
  }
  line_->to_far_.put(data);
  was_congested_ = was_congested_ || congested();
  if (congested()) line_->most_kept = std::max(line_->most_kept, line_->unread() - line_->kind_.capacity);
  quiet_since_ = world_->loop().now();
  line_->on_readable();
}

bool LinePort::end_writing() {
  world_->trace("{}: end_writing()", line_->name_);
  log(What::end_writing, false);
  if (!line_->kind_.half_closes) return false;
  line_->near_ended_ = true;
  line_->on_readable();
  return true;
}

std::optional<std::size_t> LinePort::unread_by_peer() const {
  if (!line_->kind_.knows_unread) return std::nullopt;
  return line_->unread();
}

std::optional<LineSettings> LinePort::settings() const {
  if (!line_->kind_.serial) return std::nullopt;
  return untried_ ? untried_ : asked_for_ ? asked_for_ : line_->settings_;
}

Result<void> LinePort::apply(const LineSettings& settings) {
  if (line_->kind_.is_device ? !line_->kind_.serial : line_->kind_.half_closes) return Port::apply(settings);
  world_->trace("{}: apply({})", line_->name_, to_text(SeenSettings::of(settings)));
  log({.what = What::settings, .settings = SeenSettings::of(settings)});
  if (!line_->kind_.is_device) {
    line_->settings_ = settings;
    line_->on_settings(settings);
  } else if (!up_ || interrupted_) {
    untried_ = settings;
  } else {
    make(settings);
  }
  return {};
}

void LinePort::make(const LineSettings& settings) {
  asked_for_ = settings;
  line_->to_far_.put({.what = What::settings, .settings = SeenSettings::of(settings)});
  line_->reach_acts();
}

void LinePort::tell(const LineEvent& event) {
  std::visit(LineVisitor{
                 [this](const LineSignal& signal) { tell_signal(signal); },
                 [this](const line::Drain& drain) { tell_drain(drain); },
                 [this](const line::Ask& question) { tell_question(question); },
                 [this](const line::Flush& flush) { tell_flush(flush.queue); },
                 [this](const line::Settings& settings) { tell_settings(settings); },
                 [this](const line::WatchSignals& watch) { watching_ = watch.on; },
                 [this](const line::Sent& sent) { line_->drained(sent.number); },
                 [this](const line::Answer& answer) { line_->answered(answer.number, answer.answer); },
                 [](const auto&) {},
             },
             event);
}

void LinePort::tell_signal(const LineSignal& signal) {
  log({.what = What::signal, .signal = signal});
  if (!up_ || interrupted_) return;
  if (!line_->kind_.is_device) {
    if (line_->kind_.supervised) line_->on_signal(signal);
  } else if (line_->kind_.serial) {
    line_->to_far_.put({.what = What::signal, .signal = signal});
    line_->reach_acts();
  }
}

void LinePort::tell_drain(const line::Drain& drain) {
  const std::uint64_t number = world_->next_number();
  world_->trace("{}: drain no. {}", line_->name_, number);
  log({.what = What::drain, .number = number});
  drains_[number] = [this, drain] { listener().told(line::Sent{drain.number}); };
  if (!up_ || interrupted_) return answer_all();
  line_->to_far_.put({.what = What::drain, .number = number});
  line_->reach_acts();
}

void LinePort::tell_question(const line::Ask& question) {
  const std::uint64_t number = world_->next_number();
  world_->trace("{}: question no. {}", line_->name_, number);
  log({.what = What::ask, .number = number, .request = question.request});
  const auto answer = [this, asked = question.number](const std::optional<LineAnswer>& given) {
    listener().told(line::Answer{asked, given});
  };
  if (!line_->kind_.serial) {
    log({.to_listener = true, .what = What::answered, .number = number});
    return answer(std::nullopt);
  }
  questions_[number] = answer;
  if (!up_ || interrupted_) return answer_all();
  line_->to_far_.put({.what = What::ask, .number = number, .request = question.request});
  line_->reach_acts();
}

// The far end has come so far.
void LinePort::reached(const Passed& act) {
  if (act.what == What::drain) {
    if (const auto drain = drains_.extract(act.number)) {
      world_->trace("{}: no. {} is drained", line_->name_, act.number);
      log({.to_listener = true, .what = What::drained, .number = act.number});
      drain.mapped()();
    }
  } else if (act.what == What::ask) {
    world_->after(world_->some_time(kLongestAnswer), [this, act, alive = std::weak_ptr<int>(alive_)] {
      if (alive.expired()) return;
      const auto question = questions_.extract(act.number);
      if (!question) return;
      world_->trace("{}: no. {} is answered", line_->name_, act.number);
      log({.to_listener = true, .what = What::answered, .number = act.number});
      question.mapped()(line_->on_ask(act.request));
    });
  } else if (act.what == What::settings && asked_for_ && SeenSettings::of(*asked_for_) == act.settings) {
    asked_for_.reset();
  }
}

// The line is over.
void LinePort::answer_all() {
  while (!drains_.empty()) {
    const auto drain = drains_.extract(drains_.begin());
    log({.to_listener = true, .what = What::drained, .number = drain.key(), .over = true});
    drain.mapped()();
  }
  while (!questions_.empty()) {
    const auto question = questions_.extract(questions_.begin());
    log({.to_listener = true, .what = What::answered, .number = question.key(), .over = true});
    question.mapped()(LineAnswer{.error = EIO});
  }
}

void LinePort::tell_flush(FlushQueue queue) {
  world_->trace("{}: its peer has flushed {}", line_->name_, name_of(queue));
  log({.what = What::flush, .queue = queue});
  line_->on_peer_flushed(queue);
}

void LinePort::tell_settings(const line::Settings& settings) {
  world_->trace("{}: its peer has set {}", line_->name_, to_text(settings.seen));
  log({.what = What::peer_set, .settings = settings.seen, .order = settings.order});
  line_->on_peer_set(settings.seen, settings.order);
}

void LinePort::set_reading(bool on) {
  reading_ = on;
  rest_wait_.reset();
  if (on) soon();
}

void LinePort::hang_up(bool after_reading) {
  world_->trace("{}: hang_up({})", line_->name_, after_reading ? "after reading" : "at once");
  if (!up_) return;
  leaving_ = true;
  line_->ended_before_settings_ = line_->ended_before_settings_ || line_->unseen_settings_;
  if (!after_reading) {
    drop_unsent();
    line_->to_far_.clear();
  }
  soon();
}

void LinePort::read_pending() {
  if (up_ && reading_) deliver(line_->unsent());
}

void LinePort::finish() {
  log(What::finish, false);
  listener().on_complete(0);
}

void LinePort::soon() { timer_.set(world_->loop().now()); }

void LinePort::come_up() {
  up_ = true;
  was_congested_ = false;
  if (untried_) make(*std::exchange(untried_, std::nullopt));
  log_device(What::up);
  listener().on_up();
  if (up_) tell_signals();
}

void LinePort::interrupt() {
  interrupted_ = true;
  untried_ = std::exchange(asked_for_, std::nullopt);
  log(What::interrupted, true);
  listener().on_interrupted(down(LineDown::Reason::lost));
}

void LinePort::resume() {
  if (!std::exchange(interrupted_, false)) return;
  if (untried_ && up_) make(*std::exchange(untried_, std::nullopt));
  log_device(What::resumed);
  listener().on_resumed();
  if (up_ && !interrupted_) tell_signals();
  if (accepting_ && !up_ && !interrupted_) come_up();
}

// How a device's own stand.
void LinePort::tell_signals() {
  if (!line_->kind_.serial) return;
  for (const auto& [name, on] : std::map(line_->signals_)) {
    if (up_ && !interrupted_) tell_act({.to_listener = true, .what = What::signal, .signal = {name, on}});
  }
}

void LinePort::go_down(LineDown::Reason reason, bool after_reading) {
  up_ = leaving_ = asked_ = interrupted_ = was_congested_ = false;
  answers_.reset();
  rest_wait_.reset();
  asked_for_.reset();
  line_->closing_ = false;
  line_->forget_acts();
  answer_all();
  if (const std::size_t rest = line_->unsent(); rest > 0) {
    line_->bytes_dropped += rest;
    line_->to_near_.clear();
    listener().told(line::Dropped{rest, "the line ended before them"});
  }
  if (passive()) line_->broken();
  log({.to_listener = true, .what = What::down, .reason = reason});
  listener().on_down(down(reason, after_reading));
}

void LinePort::deliver(std::size_t most) {
  if (line_->kind_.datagrams) return deliver_datagrams(most);
  const Bytes data = line_->to_near_.take(most);
  if (data.empty()) return;
  world_->trace("{}: on_data() of {} bytes", line_->name_, data.size());
  line_->bytes_in += data.size();
  log({.to_listener = true, .data = data});
  listener().on_data(data);
}

// All that begin within the next `most` bytes.
void LinePort::deliver_datagrams(std::size_t most) {
  Bytes all;
  std::vector<std::size_t> ends;
  while (all.size() < most && line_->unsent() > 0) {
    const Bytes one = line_->to_near_.take(most);
    all.insert(all.end(), one.begin(), one.end());
    ends.push_back(all.size());
    log({.to_listener = true, .data = one});
  }
  if (all.empty()) return;
  world_->trace("{}: {} datagrams of {} bytes", line_->name_, ends.size(), all.size());
  line_->bytes_in += all.size();
  if (ends.size() == 1) return listener().on_data(all);
  listener().on_arrivals(all, ends);
}

// A device that is kept open sends whether anybody listens or not.
void LinePort::deliver_between() {
  if (!reading_ || line_->unsent() == 0) return;
  soon();
  deliver(line_->unsent());
}

// One that is before all bytes, or has waited for them long enough.
bool LinePort::deliver_act() {
  const Passed* const first = line_->to_near_.first_act();
  if (first == nullptr) return false;
  const bool overtakes = !line_->to_near_.act_is_first();
  if (overtakes && world_->loop().now() - first->at < kCatchUpLimit) return false;
  Passed act = *line_->to_near_.take_act();
  if (overtakes) act.order = SettingsOrder::sampled;
  if (overtakes && act.what == What::flush && act.queue != FlushQueue::in) (void)line_->to_near_.keep(0);
  if (act.what == What::flush && act.queue != FlushQueue::out) (void)line_->to_far_.keep(0);
  tell_act(act);
  return true;
}

void LinePort::tell_act(const Passed& act) {
  switch (act.what) {
    case What::signal:
      if (line_->kind_.is_device && !watching_) return;
      world_->trace("{}: told of signal {} {}", line_->name_, porttape::name_of(act.signal.name),
                    state_text(act.signal));
      log(act);
      return listener().told(act.signal);
    case What::settings:
      world_->trace("{}: told of settings {}", line_->name_, to_text(act.settings));
      log(act);
      line_->unseen_settings_ = false;
      return listener().told(line::Settings{act.settings, act.order});
    case What::flush:
      world_->trace("{}: told of a flush of {}", line_->name_, name_of(act.queue));
      log(act);
      return listener().told(line::Flush{act.queue});
    case What::drain:
      world_->trace("{}: told of drain no. {}", line_->name_, act.number);
      log(act);
      line_->told_.insert(act.number);
      return listener().told(line::Drain{act.number});
    case What::ask:
      world_->trace("{}: told of question no. {}", line_->name_, act.number);
      log(act);
      line_->told_.insert(act.number);
      return listener().told(line::Ask{act.number, act.request});
    default:
      return;
  }
}

// One thing a turn, as a port on the loop does.
void LinePort::look() {
  if (!up_) {
    if (accepting_ && passive() && line_->open_) {
      come_up();
      soon();
    } else if (line_->kind_.always_open && prepared_ && !interrupted_) {
      line_->forget_acts();
      deliver_between();
    }
    return;
  }
  if (line_->set_) {
    soon();
    return tell_act({.to_listener = true,
                     .what = What::settings,
                     .settings = *std::exchange(line_->set_, std::nullopt),
                     .order = SettingsOrder::sampled});
  }
  if (was_congested_ && !congested()) {
    was_congested_ = false;
    soon();
    return listener().on_drained();
  }
  if (leaving_) {
    if (!line_->open_) drop_unsent();
    if (line_->unread() == 0 || !line_->open_) go_down(LineDown::Reason::hung_up);
    return;
  }
  if (!interrupted_ && deliver_act()) return soon();
  if (reading_ && line_->unsent() > 0) {
    soon();
    return deliver(static_cast<std::size_t>(world_->between(1, 4096)));
  }
  const bool gone = !line_->open_ && !interrupted_;
  if (gone) {
    drop_unsent();
    const Instant now = world_->loop().now();
    if (!rest_wait_) rest_wait_.emplace(now, kRestLimit);
    const bool kept =
        line_->unsent() > 0 && listener().wants_rest() && rest_wait_->goes_on(now, listener().unread());
    if (kept) return timer_.set_after(kLook);
    return go_down(LineDown::Reason::closed);
  }
  if (line_->ended_ && line_->unsent() == 0) {
    if (!std::exchange(asked_, true)) {
      quiet_since_ = world_->loop().now();
      log(What::ended, true);
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
  if (const Passed* const act = line_->to_near_.first_act(); act != nullptr && !timer_.due())
    timer_.set(act->at + kCatchUpLimit);
}

}  // namespace porttape::simulation
