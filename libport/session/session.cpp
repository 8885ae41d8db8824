#include "libport/session/session.hpp"

#include <cassert>
#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

using std::chrono::seconds;

// How long the last bytes of a driver that has closed may take to the device (a tty's own closing_wait is 30
// s as well).
constexpr Nanos kDrainLimit = seconds(30);
// How often an end looks at what is left.
constexpr Nanos kEndLook = std::chrono::milliseconds(50);

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
  void on_drained() override {
    session.read_device();
    session.continue_end();
  }
  void on_down(const LineDown& down) override { session.driver_down(down); }
  void on_finished(int exit_status) override { session.finished(exit_status); }
  void on_complete(int) override { session.driver_complete(); }
  void on_flush(FlushQueue queue) override { session.driver_flushed(queue); }
  Answers on_ended() override { return session.driver_ended(); }
  bool wants_rest() override { return session.device_open_ && session.taking_in_; }
  void on_interrupted(const LineDown& down) override { session.driver_interrupted(down); }
  void on_resumed() override { session.read_device(); }
  void on_dropped(std::uint64_t bytes, std::string_view why) override {
    session.dropped_by_driver(bytes, why);
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
  void on_dropped(std::uint64_t bytes, std::string_view why) override { session.dropped(bytes, why); }
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
      end_timer_(*context.loop, [this] { on_end_timer(); }),
      drain_timer_(*context.loop,
                   [this] {
                     context_.log->warn(
                         "{} did not take the driver's last bytes within {} s; they are dropped",
                         device_->name(), std::chrono::duration_cast<seconds>(kDrainLimit).count());
                     close_device();
                   }),
      limits_(limits) {
  driver_->listen(*driver_side_);
  device_->listen(*device_side_);
}

Session::~Session() = default;

Result<void> Session::start() {
  // The device first: a link that no device stands behind would only mislead.
  if (Result<void> ready = device_->prepare(); !ready) return ready;
  if (Result<void> ready = driver_->prepare(); !ready) return ready;
  driver_->open();
  return {};
}

void Session::driver_up() {
  context_.log->info("{}: a driver has opened it", driver_->name());
  driver_up_ = true;
  ++counters_.opens;
  if (closing_device_) {
    let_driver(false);  // until the last driver's bytes have gone
  } else {
    open_device();
  }
}

void Session::open_device() {
  let_driver(false);
  device_open_ = true;
  device_->open();
}

void Session::device_up() {
  device_up_ = true;
  context_.log->debug("{}: up", device_->name());
  interrupted_ = false;
  read_driver();
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
  if (gate.open || !taking_in_) return false;
  context_.log->error("{} passed on {} bytes while it was not to read (an error of this program)",
                      port.name(), data.size());
  assert(gate.open && "no on_data while set_reading(false)");
  gate.kept.insert(gate.kept.end(), data.begin(), data.end());
  return true;
}

void Session::read_driver() {
  if (taking_in_) let_driver(true);
}
void Session::read_device() {
  if (taking_in_) let_device(true);
}

PortListener::Answers Session::driver_ended() {
  if (!device_up_ || interrupted_) return PortListener::Answers::none;
  context_.log->debug("{}: the driver sends no more", driver_->name());
  return device_->end_writing() ? PortListener::Answers::until_hang_up
                                : PortListener::Answers::until_it_is_quiet;
}

void Session::dropped_by_driver(std::uint64_t bytes, std::string_view why) {
  dropped(bytes, why);
  driver_dropped_ += bytes;
  driver_dropped_why_ = why;
}

// One gap a session, since drops come by the piece.
void Session::note_gap() {
  if (driver_dropped_why_.empty()) return;
  const std::string why = std::exchange(driver_dropped_why_, {});
  const std::uint64_t bytes = std::exchange(driver_dropped_, 0);
  if (Recorder* recorder = device_->recorder()) recorder->note_gap(bytes, why);
}

void Session::dropped(std::uint64_t bytes, std::string_view why) {
  counters_.dropped_bytes += bytes;
  dropped_ += bytes;
  dropped_why_ = why;
}

void Session::tell_dropped() {
  if (dropped_ == 0) return;
  context_.log->warn("{} bytes reached nobody (the last because {})", std::exchange(dropped_, 0),
                     dropped_why_);
}

void Session::driver_interrupted(const LineDown& down) {
  context_.log->warn("{}; waiting for it", down.error.message);
  let_device(false);
}

void Session::device_interrupted(const LineDown& down) {
  context_.log->warn("{}; waiting for it", down.error.message);
  interrupted_ = true;
  if (closing_device_) {
    close_device();
  } else if (driver_up_ && device_open_) {
    let_driver(false);
  }
  continue_end();
}

void Session::device_resumed() {
  context_.log->info("{}: is back", device_->name());
  interrupted_ = false;
  if (driver_up_ && device_up_ && !device_->congested()) read_driver();
}

void Session::device_arrivals(ByteView data, std::span<const std::size_t> ends) {
  if (!driver_->keeps_datagrams()) return device_data(data);
  std::size_t begin = 0;
  for (const std::size_t end : ends) {
    device_data(data.subspan(begin, end - begin));
    begin = end;
  }
}

void Session::driver_data(ByteView data) {
  if (!taking_in_) {  // still read, since that is how its close is seen
    dropped_by_driver(data.size(),
                      device_up_ ? "they came after the end" : "the device was not there to take them");
    return;
  }
  counters_.from_driver_bytes += data.size();
  device_->write(data);
  if (device_->congested()) let_driver(false);
}

void Session::device_data(ByteView data) {
  if (!driver_up_) {
    dropped(data.size(), "no driver was there");
    return;
  }
  counters_.to_driver_bytes += data.size();
  driver_->write(data);
  if (driver_->congested()) let_device(false);
}

void Session::driver_down(const LineDown& down) {
  context_.log->info("{}: {}", driver_->name(),
                     down.reason == LineDown::Reason::hung_up ? "hung up" : "the driver has closed it");
  driver_up_ = false;
  if (ending_ == Ending::leaving) {
    end();
  } else if (!driver_->passive()) {
    driver_gone(down);
  } else if (device_open_ && device_up_ && device_->congested()) {
    closing_device_ = true;
    drain_timer_.set_after(kDrainLimit);
    read_device();
  } else if (device_open_) {
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
  closing_device_ = false;
  drain_timer_.cancel();
  device_open_ = false;
  device_up_ = false;
  note_gap();
  device_->close();
  read_device();  // only now: a tape that was held back would pour the rest into the closed line
  tell_dropped();
  if (driver_up_ && ending_ == Ending::no) open_device();
  continue_end();
}

void Session::device_drained() {
  if (closing_device_) {
    close_device();
  } else if (device_up_ && !interrupted_) {
    read_driver();
  }
  continue_end();
}

void Session::device_down(const LineDown& down) {
  device_up_ = false;
  if (closing_device_) {
    close_device();
    return;
  }
  let_driver(false);
  switch (down.reason) {
    case LineDown::Reason::failed:
    case LineDown::Reason::lost:
      context_.log->error("{}", down.error.message);
      if (!driver_->passive()) exit_status_ = exit_status_of(down.error.code);  // no next driver will come
      break;
    case LineDown::Reason::closed:
      context_.log->info("{}: closed by the device", device_->name());
      if (device_->passive()) return continue_end();  // the driver waits for the next peer
      break;
    case LineDown::Reason::hung_up:
      context_.log->info("{}: hangs up", device_->name());
      break;
  }
  let_driver(true);
  if (ending_ == Ending::no) {
    driver_->hang_up(down.after_reading);
  } else {
    continue_end();  // which hangs up
  }
}

void Session::finished(int exit_status) {
  if (ending_ != Ending::no) return;
  exit_status_ = exit_status;
  failed_ = exit_status == exit_status::kRuntime;
  context_.loop->post([this] { begin_end(); });
}

void Session::stop() {
  const bool again = std::exchange(stopped_, true);
  if (ending_ == Ending::no) return begin_end();
  if (!again) return;
  end();
  if (ending_ == Ending::completing) end_timer_.set_after(limits_.at_once);
}

void Session::begin_end() {
  if (ending_ != Ending::no) return;
  ending_ = Ending::sending;
  if (driver_up_ && device_up_) {
    driver_->read_pending();
    device_->read_pending();
  }
  taking_in_ = false;
  // What the driver wrote for a device that is not there reaches nobody: read, and told.
  if (driver_up_ && !device_up_) {
    let_driver(true);
    driver_->read_pending();
  }
  let_device(false);
  end_wait_.emplace(Loop::now(), failed_ ? limits_.failed_step : limits_.without_progress);
  end_timer_.set_after(kEndLook);
  continue_end();
}

void Session::continue_end() {
  if (ending_ != Ending::sending) return;
  if ((device_up_ && device_->congested()) || (driver_up_ && driver_->congested())) return;
  ending_ = Ending::leaving;
  if (driver_up_) {
    driver_->hang_up(true);
  } else {
    end();
  }
}

void Session::on_end_timer() {
  if (ending_ == Ending::completing) {
    context_.log->error(
        "{} and {}: what is to be completed at the end takes too long and is given up; "
        "is the disk there?",
        device_->name(), driver_->name());
    exit_status_ = exit_status::kRuntime;
    return complete();
  }
  // A failed end has its limit in all, whatever is read meanwhile.
  if (end_wait_->goes_on(Loop::now(), failed_ ? std::nullopt : left())) {
    end_timer_.set_after(kEndLook);
  } else {
    end();
  }
}

// Bytes that the peers have yet to take, where that is known of one of them.
std::optional<std::size_t> Session::left() const {
  const std::optional<std::size_t> driver = driver_up_ ? driver_->unread_by_peer() : std::nullopt;
  const bool to_device = device_up_ && device_->congested();
  const std::optional<std::size_t> device = to_device ? device_->unread_by_peer() : std::nullopt;
  if (!driver && !device) return std::nullopt;
  return driver.value_or(0) + device.value_or(0);
}

void Session::end() {
  if (ending_ >= Ending::completing) return;
  ending_ = Ending::completing;
  drain_timer_.cancel();
  end_timer_.set_after(failed_ ? limits_.failed_step : limits_.completing);
  give_up_left();
  for (const Gate* gate : {&driver_side_->gate, &device_side_->gate}) {
    if (!gate->kept.empty()) dropped_by_driver(gate->kept.size(), "the end came before them");
  }
  note_gap();
  if (device_open_) device_->close();
  device_->finish();
}

// Closes the driver's line; what it has written and nobody took, and what it has not read, is counted.
void Session::give_up_left() {
  taking_in_ = false;
  if (driver_up_) {
    let_driver(true);
    driver_->read_pending();
  }
  const bool was_up = driver_up_;
  driver_->close();
  if (!was_up) return;
  if (const std::size_t unread = driver_->unread_by_peer().value_or(0); unread > 0)
    dropped_by_driver(unread, "the driver did not read them before the end");
}

void Session::device_complete(int exit_status) {
  if (ending_ != Ending::completing) return;
  if (exit_status_ == 0) exit_status_ = exit_status;
  driver_->finish();
}

void Session::driver_complete() {
  if (ending_ == Ending::completing) complete();
}

void Session::complete() {
  ending_ = Ending::ended;
  end_timer_.cancel();
  tell_dropped();
  context_.loop->post([this] { on_end_(exit_status_); });
}

void Session::driver_flushed(FlushQueue queue) {
  if (device_open_) device_->peer_flushed(queue);
}

}  // namespace porttape
