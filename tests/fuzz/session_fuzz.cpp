// Any schedule for a session: what its two ports may tell it by their contract (port/port.hpp), in any order,
// the input says which. Every byte is delivered at once and in turn or counted, nobody is read who should
// wait and nobody waits who should be read, and the session ends once. Time does not pass: limits are for the
// tests that set a clock.

#include <array>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <spdlog/logger.h>

#include "libport/session/session.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/support/memory_port.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

using Reason = LineDown::Reason;

// A port as its peer sees it: what it may do follows from what the session has called.
struct End {
  MemoryPort::Peer peer;
  bool always_open = false;
  bool up_at_once = false;
  bool open = false;         // between open() and close()
  bool up = false;           // the line
  bool gone = false;         // it was up, or failed, and comes up again by open() only
  bool broken = false;       // it was up, or failed, and the session knows that as its end
  bool interrupted = false;  // it comes back by itself
  bool ended = false;        // the peer sends no more
  int opens = 0;
  int finishes = 0;
  bool complete = false;
  std::size_t seen = 0;  // of peer.calls

  // Follows the calls since the last look.
  void look() {
    while (seen < peer.calls.size()) {
      const std::size_t space = peer.calls.find(' ', seen);
      called(std::string_view(peer.calls).substr(seen, space - seen));
      seen = space + 1;
    }
  }

  // Whether bytes may come from it.
  [[nodiscard]] bool sends() const {
    return peer.reading && !interrupted && !ended && finishes == 0 && (up || (always_open && !open));
  }
  [[nodiscard]] bool may_come_up() const { return open && !up && !gone && !interrupted; }

 private:
  void called(std::string_view what) {
    if (what == "open") {
      ++opens;
      open = true;
      broken = false;
      up = gone = peer.up_at_once;
    } else if (what == "close") {
      open = up = gone = broken = ended = false;
      interrupted = interrupted && always_open;
    } else if (what == "finish") {
      ++finishes;
      complete = peer.completes;
    }
  }
};

class Schedule {
 public:
  explicit Schedule(Input& input) : input_(input) {
    driver_.peer.passive = input(4) != 0;
    driver_.always_open = input(2) == 1 && !driver_.peer.passive;
    device_.peer.passive = input(4) == 0;
    device_.always_open = input(2) == 1 && !device_.peer.passive;
    driver_.up_at_once = driver_.peer.up_at_once = input(2) == 1;
    device_.up_at_once = device_.peer.up_at_once = input(2) == 1;
    driver_.peer.datagrams = device_.peer.datagrams = input(4) == 0;
    device_.peer.half_closes = input(2) == 1;
    driver_.peer.completes = input(4) != 0;
    device_.peer.completes = input(4) != 0;
    if (input(2) == 1) device_.peer.settings = LineSettings{};
    device_.peer.takes_settings = input(4) != 0;
    driver_.peer.pending = [this] { pending(driver_, from_driver_); };
    device_.peer.pending = [this] { pending(device_, from_device_); };
    // No end by time, but for a second stop, which is immediate.
    const EndLimits limits{
        .without_progress = kNever, .completing = kNever, .failed_step = kNever, .at_once = {}};
    session_ = std::make_unique<Session>(
        PortContext{&loop_, log_}, std::make_unique<MemoryPort>(driver_.peer),
        std::make_unique<MemoryPort>(device_.peer), [this](int) { ++ends_; }, limits);
  }

  void run() {
    if (input_(16) == 15) device_.peer.prepared = make_error(Errc::device_missing, "not there");
    if (!session_->start()) {
      require(driver_.peer.calls.empty(), "without a device nobody is let in");
      return;
    }
    while (!input_.done() && ends_ == 0) {
      look();
      act();
      look();
      check();
    }
    end();
  }

 private:
  static constexpr Nanos kNever = std::chrono::hours(1);

  // One direction.
  struct Way {
    End& from;
    End& to;
    std::uint64_t sent = 0;
  };

  void look() {
    driver_.look();
    device_.look();
  }

  void act() {
    switch (input_(22)) {
      case 0:
        if (driver_.may_come_up()) come_up(driver_);
        break;
      case 1:
        if (device_.may_come_up()) come_up(device_);
        break;
      case 2:
      case 3:
        send(from_driver_, input_(4) == 0);
        break;
      case 4:
      case 5:
        send(from_device_, input_(4) == 0);
        break;
      case 6:
        go_down(driver_);
        break;
      case 7:
        go_down(device_);
        break;
      case 8:
        drain(driver_);
        break;
      case 9:
        drain(device_);
        break;
      case 10:
        end_sending();
        break;
      case 11:
        interrupt(input_(2) == 1 ? driver_ : device_);
        break;
      case 12:
        resume(input_(2) == 1 ? driver_ : device_);
        break;
      case 13:
        drop(input_(2) == 1 ? driver_ : device_);
        break;
      case 14:
        tell_of_line();
        break;
      case 15:
        pending_ = input_(4);
        break;
      case 16:
        if (driver_.open)
          driver_.peer.unread = input_(2) == 1 ? std::optional<std::size_t>(input_(5)) : std::nullopt;
        break;
      case 17:
        run_ready();
        break;
      case 18:
        finish();
        break;
      case 20:
        signal(input_(2) == 1 ? driver_ : device_);
        break;
      case 21:
        wait_until_sent();
        break;
      default:
        if (input_(4) == 0) stop();
    }
  }

  void come_up(End& side) {
    side.up = side.gone = true;
    side.broken = false;
    side.peer.up();
  }

  // What comes passes at once, in one piece, or is counted.
  void send(Way& way, bool congests) {
    look();
    if (!way.from.sends() || ends_ > 0) return;
    if (&way.from == &driver_ && !driver_.open) return;  // its tape may be complete already
    std::string text;
    for (std::uint32_t n = 1 + input_(3); n > 0; --n) text += static_cast<char>(way.sent++);
    const std::size_t begin = way.to.peer.written.size();
    const std::uint64_t dropped = session_->counters().dropped_bytes;
    const bool was_congested = way.to.peer.congested;
    way.to.peer.congested = was_congested || (congests && way.to.up);
    if (&way.from == &device_ && input_(2) == 1) {
      way.from.peer.arrive(text, {text.size()});
    } else {
      way.from.peer.send(text);
    }
    const bool delivered = way.to.peer.written.size() != begin;
    if (!delivered) way.to.peer.congested = was_congested;
    require(std::string_view(way.to.peer.written).substr(begin) == (delivered ? text : ""),
            "what is delivered is what came");
    const std::uint64_t lost = session_->counters().dropped_bytes - dropped;
    require(lost == (delivered ? 0 : text.size()), "what is not delivered is counted");
    counted_ += lost;
    if (&way.from == &driver_) gaps_ += lost;
  }

  // What had come in and was not read before the session asked for it.
  void pending(End& side, Way& way) {
    if (pending_ == 0) return;
    --pending_;
    send(way, input_(2) == 1);
    if (input_(4) == 0) go_down(side);
  }

  void go_down(End& side) {
    look();
    if (!side.open || (!side.up && (side.gone || side.peer.passive))) return;
    const Reason reason = side.up ? static_cast<Reason>(std::array{0, 2, 3}[input_(3)]) : Reason::failed;
    // A listener waits for the next peer; the others have had their line.
    side.gone = !side.peer.passive;
    side.broken = side.gone || reason != Reason::closed;
    side.up = side.ended = side.interrupted = false;
    side.peer.congested = false;  // what was queued went with the line, and no drain is told
    if (&side == &driver_ && !side.peer.passive) ending_ = true;
    troubles_ += &side == &device_ ? 1 : 0;
    side.peer.down(reason);
  }

  void drain(End& side) {
    if (side.peer.congested && side.up && !side.interrupted) side.peer.drain();
  }

  void end_sending() {
    if (!driver_.up || !driver_.sends()) return;
    driver_.ended = true;
    const bool told = device_.peer.calls.ends_with("end_writing ");
    const PortListener::Answers answers = driver_.peer.end();
    const bool tells = device_.peer.calls.ends_with("end_writing ") && !told;
    require(told || tells || answers == PortListener::Answers::none,
            "answers come from a device that was told");
  }

  void interrupt(End& side) {
    if (!side.always_open || side.interrupted || side.finishes > 0) return;
    if (&side == &driver_ && !side.up) return;
    side.interrupted = true;
    troubles_ += &side == &device_ ? 1 : 0;
    side.peer.up_at_once = false;
    side.peer.congested = false;
    side.peer.interrupt();
  }

  void resume(End& side) {
    if (!side.interrupted || side.finishes > 0) return;
    side.interrupted = false;
    side.peer.up_at_once = side.up_at_once;
    side.peer.resume();
  }

  void drop(End& side) {
    if (side.finishes > 0 || (&side == &driver_ && !side.open)) return;
    const std::uint64_t bytes = 1 + input_(3);
    counted_ += bytes;
    if (&side == &driver_) gaps_ += bytes;
    side.peer.drop(bytes);
  }

  void tell_of_line() {
    if (!driver_.up) return;
    if (input_(2) == 1) return driver_.peer.flush(static_cast<FlushQueue>(input_(3)));
    const SeenSettings seen{.baud = 300U << input_(4)};
    const auto before = device_.peer.settings;
    const Session::State state = session_->state();
    driver_.peer.set(seen);
    const auto followed = before && device_.peer.takes_settings ? seen.over(*before) : before;
    // The line is the last driver's, or has failed and is opened later.
    const bool not_yet = state == Session::State::draining || !device_.open;
    const bool may_wait = state == Session::State::ending && device_.peer.settings == before;
    require(device_.peer.settings == (not_yet ? before : followed) || may_wait,
            "the device's line follows the driver's");
  }

  void signal(End& side) {
    if (side.open && side.up) side.peer.signal({static_cast<LineSignal::Name>(input_(7)), input_(2) == 1});
  }

  // Each is done once, at the latest when all is over.
  void wait_until_sent() {
    if (!driver_.up) return;
    ++drains_;
    driver_.peer.wait_until_sent([this] { ++drained_; });
    if (input_(2) == 1) end_drains();
  }

  // A port does that when its line is over, too.
  void end_drains() {
    for (const auto& done : std::exchange(device_.peer.drains, {})) done();
  }

  void finish() {
    End& side = input_(4) == 0 ? driver_ : device_;
    if (side.finishes > 0) {
      if (!std::exchange(side.complete, true)) side.peer.complete();
      return;
    }
    ending_ = true;
    side.peer.finish(input_(3) == 0 ? exit_status::kRuntime : exit_status::kPass);
  }

  void stop() {
    look();
    if (!std::exchange(stopped_, true)) opens_at_stop_ = device_.opens;
    ending_ = true;
    session_->stop();
  }

  void run_ready() {
    while (loop_.poll_one()) {
    }
    loop_.restart();
  }

  // Who waits and who is read, as Session's table has it, while no end has begun.
  void check() const {
    if (ending_) return;
    const MemoryPort::Peer& driver = driver_.peer;
    const MemoryPort::Peer& device = device_.peer;
    if (!driver_.up) {
      require(!device_.open || device.congested, "without a driver the device is closed once it has all");
      return;
    }
    // A device that has failed in quick succession is opened later.
    if (!device_.open && troubles_ > 0 && session_->state() == Session::State::opening) {
      require(!driver.reading, "a driver waits for the device to be opened");
      return;
    }
    require(device_.open, "a driver has a device");
    const bool device_takes = device_.up && !device_.interrupted && !device.congested;
    require(!device_takes || driver.reading, "a driver is read when the device takes what comes");
    require(!device.congested || !driver.reading, "a driver waits for a slow device");
    require(device_.up || device_.broken || !driver.reading, "a driver waits for the device to come up");
    const bool driver_takes = !driver_.interrupted && !driver.congested;
    require(driver_takes || !device.reading, "a device is read only when the driver takes what comes");
    // One that is kept open is not read before it is up for its driver.
    require(!driver_takes || !device_.up || device.reading,
            "a device that is up is read when the driver takes what comes");
  }

  void end() {
    stop();
    session_->stop();
    for (int i = 0; ends_ == 0; ++i) {
      require(i < 1000, "an end comes to its end");
      loop_.poll_one();
      loop_.restart();
    }
    run_ready();
    look();
    require(ends_ == 1, "a session ends once");
    end_drains();
    require(drained_ == drains_, "a drain ends once");
    require(!driver_.open && !device_.open, "both ports are closed");
    require(device_.finishes == 1 && driver_.finishes <= 1, "each port is completed once");
    require(device_.opens == opens_at_stop_, "no device is opened once the end has begun");
    const std::uint64_t unread = session_->counters().dropped_bytes - counted_;
    require(unread == 0 || unread == driver_.peer.unread, "what was dropped is counted once");
    require(device_.peer.gaps == gaps_ + unread, "what the driver's side lost is on the tape");
  }

  Input& input_;
  Loop loop_;
  std::shared_ptr<spdlog::logger> log_ = std::make_shared<spdlog::logger>("fuzz");
  End driver_;
  End device_;
  Way from_driver_{driver_, device_};
  Way from_device_{device_, driver_};
  std::unique_ptr<Session> session_;
  std::uint32_t pending_ = 0;  // calls of read_pending() that find something
  std::uint64_t counted_ = 0;  // bytes that the session must have counted as dropped
  std::uint64_t gaps_ = 0;     // those of them that the device's tape must have
  int drains_ = 0;             // that the driver waits for
  int drained_ = 0;
  bool ending_ = false;
  bool stopped_ = false;
  int opens_at_stop_ = 0;
  int ends_ = 0;
  int troubles_ = 0;  // of the device
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  Schedule(input).run();
  return 0;
}
