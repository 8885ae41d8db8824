#include "libport/session/session.hpp"

#include <cassert>
#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

// How often an end looks at what is left.
constexpr Nanos kEndLook = std::chrono::milliseconds(50);
// So many bytes of a block are shown in a trace.
constexpr std::size_t kTraced = 32;

// What a line takes before it is up.
bool is_line_state(const LineEvent& event) {
  return std::holds_alternative<line::Settings>(event) || std::holds_alternative<line::Flush>(event);
}

}  // namespace

// Whether a port may pass on data, and what it passed on although it might not.
struct Session::Gate {
  bool open = true;
  Bytes kept;
};

struct Session::DriverSide final : PortListener {
  explicit DriverSide(Session& owner) : session(owner) {}
  void on_up() override { session.driver_up(); }
  void on_data(ByteView data) override {
    if (!session.keep_early(gate, *session.driver_, data)) session.driver_data(data);
  }
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override {
    if (!session.keep_early(gate, *session.driver_, data)) session.driver_arrivals(data, ends);
  }
  void on_drained() override {
    session.read_device();
    session.continue_end();
  }
  void on_down(const LineDown& down) override { session.driver_down(down); }
  void on_finished(int exit_status) override { session.finished(exit_status); }
  void on_complete(int) override { session.driver_complete(); }
  void told(const LineEvent& event) override { session.driver_told(event); }
  Answers on_ended() override { return session.driver_ended(); }
  [[nodiscard]] bool half_closes() const override { return session.device_->has_half_close(); }
  bool wants_rest() override { return session.wants_rest(); }
  [[nodiscard]] std::optional<std::size_t> unread() const override {
    return session.device_has_line() ? session.device_->unread_by_peer() : std::nullopt;
  }
  void on_interrupted(const LineDown& down) override { session.driver_interrupted(down); }
  void on_resumed() override {
    session.driver_interrupted_ = false;
    session.read_device();
  }
  Session& session;
  Gate gate;
};

struct Session::DeviceSide final : PortListener {
  explicit DeviceSide(Session& owner) : session(owner) {}
  void on_up() override { session.device_up(); }
  void on_data(ByteView data) override {
    if (!session.keep_early(gate, *session.device_, data)) session.device_data(data);
  }
  void on_drained() override { session.device_drained(); }
  void on_down(const LineDown& down) override { session.device_down(down); }
  void on_finished(int exit_status) override { session.finished(exit_status); }
  void on_complete(int exit_status) override { session.device_complete(exit_status); }
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override {
    if (!session.keep_early(gate, *session.device_, data)) session.device_arrivals(data, ends);
  }
  void on_interrupted(const LineDown& down) override { session.device_interrupted(down); }
  void on_resumed() override { session.device_resumed(); }
  Answers on_ended() override { return session.device_ended(); }
  [[nodiscard]] bool half_closes() const override { return session.driver_->has_half_close(); }
  [[nodiscard]] std::optional<std::size_t> unread() const override {
    return session.driver_up_ ? session.driver_->unread_by_peer() : 0;
  }
  void told(const LineEvent& event) override { session.device_told(event); }
  Session& session;
  Gate gate;
};

Session::Session(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<Port> device,
                 std::function<void(int)> on_end, EndLimits limits)
    : context_(context),
      driver_side_(std::make_unique<DriverSide>(*this)),
      device_side_(std::make_unique<DeviceSide>(*this)),
      driver_(std::move(driver)),
      device_(std::move(device)),
      on_end_(std::move(on_end)),
      news_(context_, *device_),
      end_timer_(*context.loop, [this] { on_end_timer(); }),
      drain_timer_(*context.loop, [this] { on_drain_timer(); }),
      open_timer_(*context.loop, [this] { open_device_now(); }),
      end_(limits) {
  driver_->listen(*driver_side_);
  device_->listen(*device_side_);
}

Session::~Session() = default;

Result<void> Session::start() {
  // The device first: a link that no device stands behind would only mislead.
  if (Result<void> ready = device_->prepare(); !ready) return ready;
  show_settings();  // before a driver can find the line, whose own settings these would undo
  if (Result<void> ready = driver_->prepare(); !ready) return ready;
  driver_->open();
  return {};
}

void Session::driver_up() {
  quiet_driver_ = news_.fails();
  refusal_told_ = false;
  context_.log->log(about_driver(), "{}: a driver has opened it", driver_->name());
  driver_up_ = true;
  ++counters_.opens;
  if (device_state_ == DeviceState::draining) {
    let_driver(false);  // until the last driver's bytes have gone
    last_bytes_.next_driver(context_.loop->now(), device_->unread_by_peer());
    drain_timer_.set_after(LastBytes::kLook);
  } else if (end_.running()) {
    open_device();
  }
}

void Session::open_device() {
  let_driver(false);
  device_state_ = DeviceState::opening;
  if (news_.may_open() > context_.loop->now()) {
    let_device(false);  // a line that is kept open may send: the driver's bytes begin with its open
    open_timer_.set(news_.may_open());
  } else {
    open_device_now();
  }
}

void Session::open_device_now() {
  if (device_state_ != DeviceState::opening) return;
  if (!end_.running()) {
    device_state_ = DeviceState::closed;  // as it was: nothing has been opened
    return;
  }
  device_->tell(line::WatchSignals{driver_->shows_signals()});
  device_->open();
  pass_early_state();  // for a line that is to come up with them
}

void Session::pass_early_state() {
  const std::vector<LineEvent> early = early_.take(is_line_state);
  for (const LineEvent& event : early) {
    if (driver_up_) driver_told(event);
  }
}

// Drains last, since they wait for the bytes.
void Session::device_up() {
  device_state_ = DeviceState::up;
  news_.up();
  context_.log->debug("{}: up", device_->name());
  pass_early_state();
  const std::vector<LineEvent> early =
      early_.take([](const LineEvent& event) { return !std::holds_alternative<line::Drain>(event); });
  for (const LineEvent& event : early) device_->tell(event);
  read_driver();
  read_device();
  for (const LineEvent& event : early_.take_all()) device_->tell(event);
}

Session::State Session::state() const {
  constexpr std::array of_device = {State::waiting,     State::opening, State::open,
                                    State::interrupted, State::broken,  State::draining};
  return end_.running() ? of_device.at(static_cast<std::size_t>(device_state_)) : State::ending;
}

Channel::Counters Session::counters() const {
  Counters counters = counters_;
  counters.dropped_bytes = news_.dropped_bytes();
  return counters;
}

// Whether a driver is there (or may come) for which open() of the device has not been called: it still
// belongs to the last driver, or has just failed.
bool Session::device_opens_later() const {
  return device_state_ == DeviceState::draining ||
         (device_state_ == DeviceState::opening && open_timer_.due());
}

// Whether what was written to it may still go out.
bool Session::device_has_line() const {
  return device_state_ == DeviceState::up || device_state_ == DeviceState::interrupted ||
         device_state_ == DeviceState::draining;
}

void Session::let_driver(bool read) {
  driver_side_->gate.open = read;
  driver_->set_reading(read);
  if (Bytes& kept = driver_side_->gate.kept; read && !kept.empty()) driver_data(std::exchange(kept, {}));
}
void Session::let_device(bool read) {
  device_side_->gate.open = read;
  device_->set_reading(read);
  if (Bytes& kept = device_side_->gate.kept; read && !kept.empty()) device_data(std::exchange(kept, {}));
}

// No port passes on data while it is told not to read: the other side may not be there to take it. One that
// does is wrong, but costs no byte.
bool Session::keep_early(Gate& gate, const Port& port, ByteView data) {
  if (gate.open || !end_.takes_in()) return false;
  context_.log->error("{} passed on {} bytes while it was not to read (an error of this program)",
                      port.name(), data.size());
  assert(gate.open && "no on_data while set_reading(false)");
  gate.kept.insert(gate.kept.end(), data.begin(), data.end());
  return true;
}

void Session::read_driver() {
  if (end_.takes_in() || takes_rest_) let_driver(true);
}

// Of a driver that has closed while it was not read. An end under way has limits of its own.
bool Session::wants_rest() const {
  if (end_.step() == SessionEnd::Step::sending) return device_has_line();
  return device_state_ != DeviceState::closed && end_.takes_in();
}

// At the end, of a driver that has closed while the device had more than it could take: what it left goes on,
// piece by piece. A driver that is still there could go on for ever: it is not read. False: nothing is left.
bool Session::take_rest() {
  if (!driver_up_ || device_state_ != DeviceState::up || !driver_->left_bytes()) return false;
  takes_rest_ = true;
  let_driver(true);
  return true;
}

// A next driver may be there already, and have more than it takes.
void Session::read_device() {
  const bool driver_is_slow = driver_interrupted_ || (driver_up_ && driver_->congested());
  if (end_.takes_in() && !driver_is_slow) let_device(true);
}

PortListener::Answers Session::driver_ended() {
  if (device_state_ != DeviceState::up) return PortListener::Answers::none;
  context_.log->debug("{}: the driver sends no more", driver_->name());
  return device_->end_writing() ? PortListener::Answers::until_hang_up
                                : PortListener::Answers::until_it_is_quiet;
}

// A driver that can be told of it may still write; any other one's line goes down with the device's. A device
// that connects may be followed by another one, for which the driver's line stays as it is.
PortListener::Answers Session::device_ended() {
  const bool passes = device_state_ == DeviceState::up && driver_up_ && end_.running();
  if (passes && device_->passive()) return PortListener::Answers::until_it_is_quiet;
  if (!passes || !driver_->end_writing()) return PortListener::Answers::none;
  context_.log->debug("{}: the device sends no more", device_->name());
  return PortListener::Answers::until_hang_up;
}

// While a line fails again and again, drivers that come and go are no news either.
spdlog::level::level_enum Session::about_driver() const {
  return quiet_driver_ ? spdlog::level::debug : spdlog::level::info;
}

void Session::driver_interrupted(const LineDown& down) {
  context_.log->warn("{}; waiting for it", down.error.message);
  driver_interrupted_ = true;
  let_device(false);
}

void Session::device_interrupted(const LineDown& down) {
  news_.device_failed(down, spdlog::level::warn, "; waiting for it");
  if (device_state_ == DeviceState::draining) {
    close_device();
  } else if (device_state_ == DeviceState::up) {
    device_state_ = DeviceState::interrupted;
    takes_rest_ = false;
    let_driver(false);
  }
  continue_end();
}

void Session::device_resumed() {
  context_.log->log(news_.fails_again() ? spdlog::level::debug : spdlog::level::info, "{}: is back",
                    device_->name());
  news_.up();
  if (device_state_ != DeviceState::interrupted) return;
  device_state_ = DeviceState::up;
  if (!device_->congested()) read_driver();
}

void Session::device_arrivals(ByteView data, std::span<const std::size_t> ends) {
  if (!driver_->keeps_datagrams()) return device_data(data);
  for_each_arrival(data, ends, [this](ByteView arrival) { device_data(arrival); });
}

// The bytes as the log shows them with --log-level trace: `->` the driver writes, `<-` it is written to.
void Session::trace(std::string_view arrow, ByteView data) const {
  if (context_.log->should_log(spdlog::level::trace))
    context_.log->trace("{} {} bytes  {}", arrow, data.size(), text_and_hex(data, kTraced));
}

void Session::driver_data(ByteView data) {
  if (!end_.takes_in() && !takes_rest_) {  // still read, since that is how its close is seen
    news_.dropped_by_driver(
        data.size(), device_has_line() ? "they came after the end" : "the device was not there to take them");
    return;
  }
  trace("->", data);
  counters_.from_driver_bytes += data.size();
  if (takes_rest_) end_.took_rest(context_.loop->now(), data.size());
  device_->write(data);
  if (device_->congested()) let_driver(false);
}

void Session::driver_arrivals(ByteView data, std::span<const std::size_t> ends) {
  if (!device_->keeps_datagrams()) return driver_data(data);
  for_each_arrival(data, ends, [this](ByteView arrival) { driver_data(arrival); });
}

void Session::device_data(ByteView data) {
  news_.device_works();
  if (!driver_up_) {
    news_.dropped(data.size(), "no driver was there");
    return;
  }
  trace("<-", data);
  counters_.to_driver_bytes += data.size();
  driver_->write(data);
  if (driver_->congested()) let_device(false);
}

void Session::driver_down(const LineDown& down) {
  if (device_state_ == DeviceState::up) news_.device_works();
  context_.log->log(about_driver(), "{}: {}", driver_->name(),
                    down.reason == LineDown::Reason::hung_up ? "hung up" : "the driver has closed it");
  driver_up_ = driver_interrupted_ = takes_rest_ = false;
  drop_early();
  if (end_.step() == SessionEnd::Step::leaving) {
    end();
  } else if (!driver_->passive()) {
    driver_gone(down);
  } else if (device_has_line() && device_->congested()) {
    device_state_ = DeviceState::draining;
    last_bytes_.begin(context_.loop->now());
    on_drain_timer();
    read_device();
  } else if (device_state_ != DeviceState::closed) {
    close_device();
  }
  continue_end();
}

// A driver's port that does not wait for the next peer has done its part.
void Session::driver_gone(const LineDown& down) {
  const bool failed = down.reason == LineDown::Reason::failed || down.reason == LineDown::Reason::lost;
  if (failed) context_.log->error("{}", down.error.message);
  finished(failed ? exit_status_of(down.error.code) : exit_status_);
}

void Session::close_device() {
  drain_timer_.cancel();
  open_timer_.cancel();
  device_state_ = DeviceState::closed;
  news_.note_gap();
  device_->close();
  read_device();  // only now: a tape that was held back would pour the rest into the closed line
  news_.tell_dropped();
  if (driver_up_ && end_.running()) open_device();
  continue_end();
}

void Session::on_drain_timer() {
  if (last_bytes_.goes_on(context_.loop->now(), device_->unread_by_peer()))
    return drain_timer_.set_after(LastBytes::kLook);
  context_.log->warn("{} does not take the driver's last bytes; they are dropped", device_->name());
  close_device();
}

void Session::device_drained() {
  if (device_state_ == DeviceState::draining) {
    close_device();
  } else if (device_state_ == DeviceState::up) {
    read_driver();
  }
  continue_end();
}

void Session::device_down(const LineDown& down) {
  if (device_state_ == DeviceState::draining) return close_device();
  device_state_ = DeviceState::down;
  takes_rest_ = false;
  drop_early();
  switch (down.reason) {
    case LineDown::Reason::failed:
    case LineDown::Reason::lost:
      news_.device_failed(down, spdlog::level::err);
      ++counters_.device_losses;
      if (!driver_->passive()) exit_status_ = exit_status_of(down.error.code);  // no next driver will come
      break;
    case LineDown::Reason::closed:
      context_.log->info("{}: closed by the device", device_->name());
      if (device_->passive()) return device_waits();
      break;
    case LineDown::Reason::hung_up:
      context_.log->info("{}: hangs up", device_->name());
      break;
  }
  let_driver(true);
  if (end_.running()) {
    driver_->hang_up(down.after_reading);
  } else {
    continue_end();  // which hangs up
  }
}

// For its next peer, and the driver with it.
void Session::device_waits() {
  device_state_ = DeviceState::opening;
  let_driver(false);
  continue_end();
}

void Session::finished(int exit_status) {
  if (!end_.running()) return;
  exit_status_ = exit_status;
  if (exit_status == exit_status::kRuntime) end_.fail();
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) begin_end();
  });
}

void Session::stop() {
  if (!driver_up_ && end_.running()) driver_->read_pending();  // a driver that nothing has told of yet
  switch (end_.stop()) {
    case SessionEnd::Stop::begin:
      return begin_end();
    case SessionEnd::Stop::wait:
      return;
    case SessionEnd::Stop::give_up:
      end();
      if (end_.step() == SessionEnd::Step::completing) end_timer_.set_after(end_.completing_limit());
  }
}

void Session::begin_end() {
  if (!end_.begin()) return;
  if (driver_up_ && device_has_line()) {
    driver_->read_pending();
    device_->read_pending();
  }
  end_.send(context_.loop->now());
  // What the driver wrote for a device that is not there reaches nobody: read, and told.
  if (driver_up_ && !device_has_line()) {
    let_driver(true);
    driver_->read_pending();
  }
  let_device(false);
  end_timer_.set_after(kEndLook);
  continue_end();
}

void Session::continue_end() {
  if (end_.step() != SessionEnd::Step::sending) return;
  if ((device_has_line() && device_->congested()) || (driver_up_ && driver_->congested())) return;
  if (take_rest()) return;
  end_.leave();
  if (driver_up_) {
    driver_->hang_up(true);
  } else {
    end();
  }
}

void Session::on_end_timer() {
  if (end_.step() == SessionEnd::Step::completing) {
    context_.log->error(
        "{} and {}: what is to be completed at the end takes too long and is given up; "
        "is the disk there?",
        device_->name(), driver_->name());
    exit_status_ = exit_status::kRuntime;
    complete();
  } else if (end_.waits_on(context_.loop->now(), left())) {
    end_timer_.set_after(kEndLook);
    continue_end();  // no event tells that a driver that only sends no more has been read
  } else {
    end();
  }
}

// Bytes that the peers have yet to take, where that is known of one of them.
std::optional<std::size_t> Session::left() const {
  const std::optional<std::size_t> driver = driver_up_ ? driver_->unread_by_peer() : std::nullopt;
  const bool to_device = device_has_line() && device_->congested();
  const std::optional<std::size_t> device = to_device ? device_->unread_by_peer() : std::nullopt;
  if (!driver) return device;
  return device ? *driver + *device : driver;
}

void Session::end() {
  if (!end_.complete()) return;
  takes_rest_ = false;  // the device may have more than it can take
  drain_timer_.cancel();
  open_timer_.cancel();
  end_timer_.set_after(end_.completing_limit());
  give_up_left();
  drop_early();
  for (const Gate* gate : {&driver_side_->gate, &device_side_->gate}) {
    if (!gate->kept.empty()) news_.dropped_by_driver(gate->kept.size(), "the end came before them");
  }
  news_.note_gap();
  if (std::exchange(device_state_, DeviceState::closed) != DeviceState::closed) device_->close();
  device_->finish();
}

// Closes the driver's line; what it has written and nobody took, and what it has not read, is counted.
void Session::give_up_left() {
  if (driver_up_) {
    let_driver(true);
    driver_->read_pending();
  }
  const bool was_up = driver_up_;
  driver_->close();
  if (!was_up) return;
  news_.dropped_by_driver(driver_->unread_by_peer().value_or(0),
                          "the driver did not read them before the end");
}

void Session::device_complete(int exit_status) {
  if (end_.step() != SessionEnd::Step::completing) return;
  if (exit_status_ == 0) exit_status_ = exit_status;
  driver_->finish();
}

void Session::driver_complete() {
  if (end_.step() == SessionEnd::Step::completing) complete();
}

void Session::complete() {
  end_.end();
  end_timer_.cancel();
  news_.end();
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) on_end_(exit_status_);
  });
}

// A driver finds the line as the device's is, where its port can show that.
void Session::show_settings() {
  if (const auto settings = device_->settings()) (void)driver_->apply(*settings);
}

// Whether the device is told of it only once it is open, or its line is up.
bool Session::waits_for_device(const LineEvent& event) const {
  if (is_line_state(event)) return device_opens_later();
  return keeps_place(event) &&
         (device_state_ == DeviceState::opening || device_state_ == DeviceState::draining);
}

void Session::driver_told(const LineEvent& event) {
  if (waits_for_device(event)) return early_.put(event);
  const auto to_line = [this](const LineEvent& of_line) {
    if (device_has_line()) {
      device_->tell(of_line);
    } else if (const auto answer = answer_without_device(of_line)) {
      driver_->tell(*answer);
    }
  };
  std::visit(LineVisitor{
                 [this](const line::Settings& settings) { driver_set(settings); },
                 [this](const line::Dropped& lost) { news_.dropped_by_driver(lost.bytes, lost.why); },
                 [this](const line::Flush& flush) {
                   if (device_state_ != DeviceState::closed) device_->tell(flush);
                 },
                 [](const LineFault&) {},  // of the driver's port, which no tape is around
                 [&](const auto& other) {
                   if (keeps_place(other)) return to_line(other);
                   device_->tell(other);
                 },
             },
             event);
}

void Session::device_told(const LineEvent& event) {
  std::visit(LineVisitor{
                 [this](const line::Settings&) { show_settings(); },  // it took others than asked for
                 [this](const line::Dropped& lost) { news_.dropped(lost.bytes, lost.why); },
                 [this](const line::Sent& sent) { driver_->tell(sent); },
                 [this](const line::Answer& answer) { driver_->tell(answer); },
                 [](const line::Flush&) {},  // a driver alone asks for this, and for the next two
                 [](const line::Drain&) {},
                 [](const line::Ask&) {},
                 [this](const auto& other) {
                   if (driver_up_ && keeps_place(other)) driver_->tell(other);
                 },
             },
             event);
}

// The device's line follows the driver's. One that does not is shown to it.
void Session::driver_set(const line::Settings& settings) {
  if (device_state_ == DeviceState::closed && !end_.running()) return;  // it is opened for no next driver
  device_->tell(settings);
  const std::optional<LineSettings> now = device_->settings();
  if (!now || settings.seen.over(*now) == *now) return;
  if (const Result<void> set = device_->apply(settings.seen.over(*now)); !set) {
    const bool told = std::exchange(refusal_told_, true);
    context_.log->log(told ? spdlog::level::debug : spdlog::level::warn, "{}; the device keeps its settings",
                      set.error().message);
    show_settings();
  }
}

// The line that they were for is over.
void Session::drop_early() {
  for (const LineEvent& event : early_.take_all()) {
    if (const auto answer = answer_without_device(event)) driver_->tell(*answer);
  }
}

}  // namespace porttape
