#include "tests/simulation/tape_steps.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <fmt/format.h>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <variant>

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using What = Passed::What;

// A flush so soon after another one of its queue is not on the tape. Near this limit it may be.
constexpr Nanos kFlushes = milliseconds(10);
constexpr Nanos kNear = milliseconds(1);

enum class Wanted { no, maybe, yes };

// FORMAT.md, "Settings": what is as it was is not written again, but for a driver's first ones in a session.
class ExpectedSettings {
 public:
  void begin_session() { last_[0].reset(); }

  Wanted take(Side by, const SeenSettings& seen) {
    std::optional<SeenSettings>& last = last_.at(by == Side::driver ? 0 : 1);
    const SeenSettings line = seen.over(line_);
    const bool as_it_was = line == line_;
    const bool again = last == seen;
    const bool first = !last;
    last = seen;
    line_ = line;
    if (!as_it_was || first) return Wanted::yes;
    return again ? Wanted::no : Wanted::maybe;
  }

 private:
  std::array<std::optional<SeenSettings>, 2> last_;  // the driver's, the device's
  SeenSettings line_;
};

// FORMAT.md, "Flushes".
class ExpectedFlushes {
 public:
  void on_bytes() { maybe_ = {Last{}}; }

  Wanted take(FlushQueue queue, Instant at) {
    std::set<Wanted> all;
    std::set<Last> next;
    for (const Last& last : maybe_) {
      const Wanted wanted = of(last, queue, at);
      all.insert(wanted);
      if (wanted != Wanted::yes) next.insert(last);
      if (wanted == Wanted::no) continue;
      next.insert({queue == FlushQueue::out ? last.first : at, queue == FlushQueue::in ? last.second : at});
    }
    maybe_ = std::move(next);
    return all.size() == 1 ? *all.begin() : Wanted::maybe;
  }

 private:
  // Those that are on the tape, of the input and of the output.
  using Last = std::pair<std::optional<Instant>, std::optional<Instant>>;

  static Wanted of(const Last& last, FlushQueue queue, Instant at) {
    Wanted wanted = Wanted::no;
    if (queue != FlushQueue::out) wanted = std::max(wanted, of(last.first, at));
    if (queue != FlushQueue::in) wanted = std::max(wanted, of(last.second, at));
    return wanted;
  }
  static Wanted of(const std::optional<Instant>& last, Instant at) {
    const Nanos since = last ? at - *last : Nanos::max();
    if (since < kFlushes - kNear) return Wanted::no;
    return since < kFlushes + kNear ? Wanted::maybe : Wanted::yes;
  }

  std::set<Last> maybe_ = {Last{}};  // each that may be so
};

// What a tape of this port must tell.
class ExpectedSteps {
 public:
  ExpectedSteps(const Line& device, bool whole) : device_(&device), whole_(whole) {
    for (const Passed& each : device.passed) take(each);
  }

  [[nodiscard]] const std::vector<TapeStep>& steps() const { return steps_; }

 private:
  void put(const Event& event, Wanted wanted = Wanted::yes) {
    begun_ = begun_ || std::holds_alternative<event::Open>(event);
    if (wanted == Wanted::no || !begun_) return;
    steps_.push_back(
        {.what = step_text(event), .read = read_, .written = written_, .optional = wanted == Wanted::maybe});
  }

  void take(const Passed& passed) {
    switch (passed.what) {
      case What::data:
        if (begun_) (passed.to_listener ? read_ : written_) += passed.data.size();
        return flushes_.on_bytes();
      case What::prepare:
      case What::finish:
        begun_ = false;  // no tape until the next first open
        settings_ = {};
        flushes_ = {};
        return;
      case What::open:
        is_open_ = true;
        ended_ = false;
        settings_.begin_session();
        flushes_.on_bytes();
        return put(event::Open{});
      case What::close:
        is_open_ = false;
        return put(event::Close{});
      case What::up:
        return put_device_settings(passed);
      case What::resumed:
        put(event::DeviceBack{});
        return put_device_settings(passed);
      case What::interrupted:
        return put(event::DeviceLost{"", false});
      case What::down:
        if (device_->kind().passive) return;
        return put(event::DeviceLost{"", true},
                   ended_ && passed.reason == LineDown::Reason::closed ? Wanted::maybe : Wanted::yes);
      case What::ended:
        if (device_->kind().passive) return;  // the driver is not told, see Session
        return put(event::HalfClose{Side::device});
      case What::end_writing:
        ended_ = true;
        return put(event::HalfClose{Side::driver});
      case What::signal:
        return put_signal(passed);
      case What::peer_set:
        return put(event::Settings{Side::driver, passed.settings, passed.order},
                   settings_.take(Side::driver, passed.settings));
      case What::flush:
        return put_flush(passed);
      case What::drained:
        // A drain that only the line's end has ended: FORMAT.md does not say.
        if (is_open_) put(event::Drain{}, passed.over ? Wanted::maybe : Wanted::yes);
        return;
      default:
        return;
    }
  }

  void put_device_settings(const Passed& passed) {
    if (!device_->kind().serial) return;
    put(event::Settings{Side::device, passed.settings, SettingsOrder::exact},
        settings_.take(Side::device, passed.settings));
  }

  void put_signal(const Passed& passed) {
    const bool by_driver =
        !passed.to_listener && (is_output(passed.signal.name) || passed.signal.name == LineSignal::Name::brk);
    put(signal_event({by_driver ? Side::driver : Side::device, passed.signal}));
  }

  void put_flush(const Passed& passed) {
    using Queue = FlushQueue;
    constexpr std::array queues = {Queue::in, Queue::out, Queue::both};
    const Wanted wanted = flushes_.take(passed.queue, passed.at);
    // A disk that stalls comes between the tape's moment and the port's.
    put(event::Flush{queues.at(static_cast<std::size_t>(passed.queue))},
        whole_ ? wanted : std::max(wanted, Wanted::maybe));
  }

  const Line* device_;
  bool whole_;
  std::vector<TapeStep> steps_;
  std::uint64_t read_ = 0;
  std::uint64_t written_ = 0;
  bool begun_ = false;  // with the first open
  bool is_open_ = false;
  bool ended_ = false;  // the driver sends no more, in this session
  ExpectedSettings settings_;
  ExpectedFlushes flushes_;
};

}  // namespace

std::string step_text(const Event& event) {
  if (std::holds_alternative<event::Gap>(event) || std::holds_alternative<event::Mark>(event) ||
      std::holds_alternative<event::End>(event) || std::holds_alternative<event::Zero>(event) ||
      std::holds_alternative<event::Fault>(event))
    return {};
  if (std::holds_alternative<event::Drain>(event)) return "drain";
  if (const auto* const lost = std::get_if<event::DeviceLost>(&event))
    return lost->hung_up ? "device-lost with the driver's line" : "device-lost";
  constexpr std::string_view kTime = "{\"t_us\":0,";
  std::string text = encode(TapeTime{}, event);
  text.pop_back();
  return text.substr(kTime.size());
}

void check_tape_steps(World& world, const std::string& name, const Line& device,
                      const std::vector<TapeStep>& taped, bool whole) {
  const std::vector<TapeStep> expected = ExpectedSteps(device, whole).steps();
  const auto tell = [](const TapeStep& step) {
    return fmt::format("{} after {} bytes read and {} written", step.what, step.read, step.written);
  };
  const auto may_miss = [whole](const TapeStep& step) { return !whole || step.optional; };
  const auto is_it = [whole](const TapeStep& other, const TapeStep& step) {
    return other.what == step.what && (!whole || (other.read == step.read && other.written == step.written));
  };
  // Which of the expected steps may be next: one that may be left out can look like one that may not.
  std::set<std::size_t> places = {0};
  for (const TapeStep& step : taped) {
    if (step.carried && !whole) continue;
    std::set<std::size_t> next;
    if (step.carried) next = places;
    for (const std::size_t place : places) {
      for (std::size_t at = place; at < expected.size(); ++at) {
        if (is_it(expected[at], step)) next.insert(at + 1);
        if (!may_miss(expected[at])) break;
      }
    }
    if (next.empty()) {
      const std::size_t last = *places.rbegin();
      return world.wrong("{}: the tape has {}; next on the line is {}", name, tell(step),
                         last == expected.size() ? "nothing" : tell(expected[last]));
    }
    places = std::move(next);
  }
  const auto missing = [&](std::size_t place) {
    return std::find_if(expected.begin() + static_cast<std::ptrdiff_t>(place), expected.end(),
                        [&](const TapeStep& step) { return !may_miss(step); });
  };
  const bool complete =
      std::ranges::any_of(places, [&](std::size_t place) { return missing(place) == expected.end(); });
  if (!complete) world.wrong("{}: the tape ends before {}", name, tell(*missing(*places.rbegin())));
}

}  // namespace porttape::simulation
